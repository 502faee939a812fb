"""The page for the PLC engineer says what the map says."""

from __future__ import annotations

import re
from pathlib import Path

from lumpwatch.service.gateway import codes
from lumpwatch.service.gateway.register_map import BLOCK, REGION_COILS, STATE_BITS
from lumpwatch.service.gateway.values import Why
from tests.gateway.site import config, points

PAGE = (Path(__file__).parents[2] / "docs" / "plc.md").read_text(encoding="utf-8")


def test_every_value_stands_there_with_its_place() -> None:
    rows = {}
    for first, names in re.findall(r"^\| ([\d, ]+) \| ((?:`\w+`[^|]*)+)\|", PAGE, re.MULTILINE):
        places = [int(n) for n in first.split(",")]
        for i, name in enumerate(re.findall(r"`(\w+)`", names)):
            rows[name] = places[min(i, len(places) - 1)] if len(places) > 1 else places[0]
    rows |= (
        {"prior": 16, "sequence": 18}
        if "| 16, 17 | `prior`" in PAGE and "| 18, 19 | `sequence`" in PAGE
        else {}
    )
    for name, point in points(config()).items():
        if point.table == "input" and "/" in name:
            assert rows.get(name.rpartition("/")[2]) == point.address - BLOCK, name


def test_every_number_and_bit_stands_there() -> None:
    for table in (codes.DECISIONS, codes.ALARM_STATES, codes.BLIND_REASONS, codes.FEED_STATES):
        for word, number in table.items():
            assert f"{number} {word}" in PAGE, word
    for why in Why:
        assert f"| {why.value} {why.name.lower()} |" in PAGE, why
    for i, (name, _) in enumerate(STATE_BITS):
        assert re.search(rf"^\| ([\d, ]+, )?{i}(, [\d, ]+)? ?({name}|\|)", PAGE, re.MULTILINE), name
    for coil in REGION_COILS:
        assert f"`{coil.name}`" in PAGE, coil.name
