"""Where values lie, what they look like in a register, and that nothing ever moves."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

import pytest

from lumpwatch.service.cli import main
from lumpwatch.service.config import parse_config
from lumpwatch.service.core import AlarmClass, AlarmState, BlindReason, Decision, FeedState
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.gateway import codes
from lumpwatch.service.gateway.register_map import BLOCK, COILS, STATE_BITS, RegisterMap, state_word
from lumpwatch.service.gateway.values import FeedValues, Quality, RegionValues, SiteValues, Why
from tests.gateway.site import CAMERA, CONFIG, REGION, ROI, config, points

# Published: whoever has to change a line here breaks the programs of plants.
PUBLISHED = {
    "map_version": 0, "heartbeat": 1, "quality": 2, "regions": 3, "layout": 4,
    "cam/apron/state": 64, "cam/apron/quality": 65, "cam/apron/quality_reason": 66, "cam/apron/heartbeat": 67,
    "cam/apron/decision": 68, "cam/apron/blind_reason": 69, "cam/apron/alarm": 70, "cam/apron/blind_alarm": 71,
    "cam/apron/system_alarm": 72, "cam/apron/existence": 73, "cam/apron/count": 74, "cam/apron/largest": 75,
    "cam/apron/lip": 76, "cam/apron/speed": 77, "cam/apron/size_limit": 78, "cam/apron/prior": 80,
    "cam/apron/sequence": 82, "cam/apron/blocked_alarm": 84, "cam/apron/feed_state": 85,
    "cam/apron/feed_speed": 86, "cam/apron/load": 87, "cam/apron/visible_p80": 88,
    "cam/apron/mouth_standing": 89, "cam/apron/mouth_stood": 90,
}  # fmt: skip
PUBLISHED_COILS = {
    "cam/apron/ack": 16, "cam/apron/ack_blind": 17, "cam/apron/ack_system": 18, "cam/apron/ack_blocked": 19,
    "cam/apron/feeder_runs": 24, "cam/apron/maintenance": 25,
}  # fmt: skip
SEEN = RegionValues(
    CAMERA, ROI, quality=Quality.GOOD, why=Why.GOOD, lives=True, heartbeat=7, decision=Decision.CLEAR,
    alarms=dict.fromkeys(AlarmClass, AlarmState.NORMAL), lump=False, system=False, blocked=False,
    existence=0.0215, count=0, limit_mm=700.0, prior=0, trained=False, sequence=70_000,
)  # fmt: skip


def words(*regions: RegionValues, of: str = "{}") -> dict[str, int]:
    site = config(of)
    content = RegisterMap(site).words(SiteValues("pit", 3, regions))
    return {
        p.name: content[p.address]
        if p.type == "uint16"
        else content[p.address] << 16 | content[p.address + 1]
        for p in points(site).values()
        if p.table == "input"
    }


def test_nothing_moves() -> None:
    found = points(config())
    assert {n: found[n].address for n in PUBLISHED} == PUBLISHED
    assert {n: found[n].address for n in PUBLISHED_COILS} == PUBLISHED_COILS
    assert {name for name, p in found.items() if p.table == "input"} == set(PUBLISHED), "add it to PUBLISHED"


def test_holding_registers_are_a_copy() -> None:
    every = RegisterMap(config()).points
    input_, holding = (
        [(p.name, p.address, p.type) for p in every if p.table == table] for table in ("input", "holding")
    )
    assert input_ == holding


def test_what_is_not_known_is_no_zero_and_what_is_unwritten_is_bad() -> None:
    found = words(RegionValues(CAMERA, ROI))
    silent = {"state": 0, "quality": 0, "quality_reason": 2, "heartbeat": 0, "size_limit": 65535}
    assert {name: found[f"cam/apron/{name}"] for name in silent} == silent
    for name in ("decision", "blind_reason", "alarm", "blind_alarm", "system_alarm", "existence", "count", "largest",
                 "lip", "speed", "blocked_alarm", "feed_state", "feed_speed", "load", "visible_p80",
                 "mouth_standing", "mouth_stood"):  # fmt: skip
        assert found[f"cam/apron/{name}"] == 65535, name
    assert found["cam/apron/prior"] == found["cam/apron/sequence"] == 0xFFFFFFFF


def test_a_region_that_sees() -> None:
    found = words(SEEN)
    expected = {
        "state": 0b11001, "quality": 192, "quality_reason": 1, "heartbeat": 7, "decision": 1, "blind_reason": 1,
        "alarm": 1, "existence": 22, "count": 0, "largest": 65535, "size_limit": 700, "prior": 0, "sequence": 70_000,
    }  # fmt: skip
    assert {name: found[f"cam/apron/{name}"] for name in expected} == expected
    assert (found["map_version"], found["heartbeat"], found["quality"], found["regions"]) == (2, 3, 192, 1)


def test_values_that_do_not_fit_are_the_largest_and_not_the_mark_of_absence() -> None:
    found = words(replace(SEEN, largest_mm=1e9, lip_s=-1.0, speed_mm_s=math.nan, prior=2**40))
    assert found["cam/apron/largest"] == 65534
    assert found["cam/apron/lip"] == 0
    assert found["cam/apron/speed"] == 65535
    assert found["cam/apron/prior"] == 0xFFFFFFFE


def test_the_feed_where_it_is_told_of() -> None:
    found = words(replace(SEEN, feed=FeedValues("stopped", 0.0, 0.93, 340.0)))
    told = {"feed_state": 3, "feed_speed": 0, "load": 930, "visible_p80": 340}
    assert {name: found[f"cam/apron/{name}"] for name in told} == told


def test_bits_of_the_state_word() -> None:
    def bits(region: RegionValues) -> set[str]:
        return {name for i, (name, _) in enumerate(STATE_BITS) if state_word(region) >> i & 1}

    assert bits(RegionValues(CAMERA, ROI)) == set()
    assert bits(SEEN) == {"CLEAR", "GOOD", "LIVES"}
    assert bits(replace(SEEN, quality=Quality.UNCERTAIN)) == {"LIVES"}
    stands = dict.fromkeys(AlarmClass, AlarmState.NORMAL)
    raised = replace(
        SEEN,
        decision=Decision.LUMP,
        lump=True,
        trained=True,
        alarms=stands | {AlarmClass.LUMP: AlarmState.UNACKNOWLEDGED, AlarmClass.BLIND: AlarmState.SHELVED},
    )
    assert bits(raised) == {"LUMP", "GOOD", "LIVES", "LUMP_ALARM", "WAITS", "HELD", "TRAINED"}
    held = replace(SEEN, lump=True)  # suppressed: the condition shows all the same
    assert bits(held) == {"LUMP", "GOOD", "LIVES"}
    assert bits(replace(SEEN, blocked=True)) == {"BLOCKED", "GOOD", "LIVES"}


@pytest.mark.parametrize(
    ("words_", "table"),
    [
        (BlindReason, codes.BLIND_REASONS),
        (AlarmState, codes.ALARM_STATES),
        (Decision, codes.DECISIONS),
        (FeedState, codes.FEED_STATES),
    ],
)
def test_every_word_has_a_number_of_its_own(words_: type[StrEnum], table: dict[str, int]) -> None:
    assert {str(word) for word in words_} <= set(table)
    assert len(set(table.values())) == len(table)
    assert not {0, codes.OTHER, 65535} & set(table.values())


def test_a_named_order_keeps_addresses_when_a_camera_comes_first() -> None:
    text = CONFIG.format(endpoint="tcp/127.0.0.1:7447", gateway='{order: ["cam/apron"]}')
    head, _, camera = text.partition("  - id: cam\n")
    added = f"{head}  - id: new\n{camera}  - id: cam\n{camera}"

    named = RegisterMap(parse_config(added))
    assert named.regions == (REGION, ("new", "apron"))
    found = {p.name: p.address for p in named.points if p.table == "input"}
    assert found["cam/apron/state"] == BLOCK
    assert found["new/apron/state"] == 2 * BLOCK
    assert named.layout != RegisterMap(config()).layout


def test_a_region_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigError, match=r"gateway\.order: no camera has the region 'cam/other'"):
        config('{order: ["cam/other"]}')
    with pytest.raises(ConfigError, match="more than once"):
        config('{order: ["cam/apron", "cam/apron"]}')


def test_an_address_that_others_reach_needs_clients() -> None:
    with pytest.raises(ConfigError, match=r"gateway\.modbus: an address that others reach needs clients"):
        config('{modbus: {listen: "0.0.0.0:502"}}')
    assert config('{modbus: {listen: "0.0.0.0:502", clients: ["10.0.0.7", "10.1.0.0/16"]}}').gateway.modbus


def test_coils() -> None:
    register_map = RegisterMap(config())
    assert register_map.coil(COILS) == (REGION, "ack")
    assert register_map.coil(COILS + 9) == (REGION, "maintenance")
    assert [register_map.coil(a) for a in (0, COILS - 1, COILS + 15, 2 * COILS)] == [None] * 4


def test_the_map_is_printed_as_table_csv_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(CONFIG.format(endpoint="tcp/127.0.0.1:7447", gateway="{}"))
    assert main(["gateway", str(file), "--map", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told[0]) == {"name", "table", "address", "type", "unit", "scale", "about"}
    assert {p["table"] for p in told} == {"input", "holding", "coil"}
    assert main(["gateway", str(file), "--map", "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [(r["name"], r["table"], int(r["address"])) for r in rows] == [
        (p["name"], p["table"], p["address"]) for p in told
    ]
    assert main(["gateway", str(file), "--map"]) == 0
    assert "cam/apron/heartbeat" in capsys.readouterr().out


def test_nothing_to_serve_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(CONFIG.format(endpoint="tcp/127.0.0.1:7447", gateway="{}"))
    assert main(["gateway", str(file)]) == 2
    assert (
        "nothing to serve: expected gateway.modbus, gateway.opcua or gateway.mqtt" in capsys.readouterr().err
    )
