"""`lumpwatch evidence`: list, show and fetch what is kept of alarms; from the store, or over the bus."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.core import printable
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.evidence import (
    EvidenceError,
    EvidenceStore,
    as_json,
    copy_evidence,
    fetch_evidence,
    verdicts_by_id,
)
from lumpwatch.service.protocol import EvidenceMeta
from lumpwatch.service.storage import event_file

_WIDE = 200


def evidence(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if (arguments.what == "list") != (arguments.id is None):
        raise ConfigError(f"evidence {arguments.what} {'takes no' if arguments.id else 'needs an'} ID")
    if (arguments.what == "fetch") != (arguments.out is not None):
        raise ConfigError("evidence fetch needs --out DIR, and only that does")
    config = load_config(arguments.config, secrets=arguments.bus)
    if not arguments.bus:
        return _from_store(arguments, config)
    with open_client(as_client(config.bus), wait=False) as bus:
        return _from_bus(arguments, config, bus)


def _from_store(arguments: argparse.Namespace, config: SiteConfig) -> int:
    store = EvidenceStore(config.store.path)

    def known(camera: str) -> dict[tuple[str, str], str]:
        return verdicts_by_id(event_file(config.store.path, camera))

    if arguments.what == "list":
        verdicts = {camera.id: known(camera.id) for camera in config.cameras}
        found = [as_json(stored.meta, verdicts.get(stored.meta.camera, {})) for stored in store.listed()]
        return _list(found, arguments.json)
    stored = store.find(arguments.id)
    if arguments.what == "show":
        return _show(as_json(stored.meta, known(stored.meta.camera)))
    _say(f"{copy_evidence(stored, arguments.out).folder}")
    return 0


def _from_bus(arguments: argparse.Namespace, config: SiteConfig, bus: Bus) -> int:
    keys = Keys(config.site)
    found: list[dict[str, Any]] = []
    for reply in bus.ask(keys.commands("evidence"), timeout_s=10.0):
        if reply.payload is None:
            raise EvidenceError(f"{reply.key}: {reply.error}")
        found += _listed(reply.key, reply.payload)
    if arguments.what == "list":
        return _list(sorted(found, key=lambda item: str(item["time"])), arguments.json)
    name = arguments.id
    wanted = [item for item in found if name in (item["id"], f"{item['camera']}/{item['roi']}/{item['id']}")]
    if len(wanted) != 1:
        raise EvidenceError(
            f"{name}: the daemon has {'several of that id' if wanted else 'no such evidence'}"
        )
    item = wanted[0]
    if arguments.what == "show":
        return _show(item)
    copied = fetch_evidence(
        bus, keys.command(item["camera"], item["roi"], "evidence"), item["id"], arguments.out
    )
    _say(f"{copied.folder}")
    return 0


def _listed(key: str, payload: bytes) -> list[dict[str, Any]]:
    """The list that a monitor answers. Raises EvidenceError."""
    try:
        listed = json.loads(payload)
    except (ValueError, RecursionError):
        listed = None
    named = ("id", "camera", "roi", "time")
    if not isinstance(listed, list) or not all(
        isinstance(item, dict) and all(isinstance(item.get(name), str) for name in named) for item in listed
    ):
        raise EvidenceError(f"{key}: the answer is no list of evidence")
    return listed


def _list(found: list[dict[str, Any]], as_lines: bool) -> int:
    if as_lines:
        for item in found:
            _say(json.dumps(item))
        return 0
    table = Table("id", "alarm", "time (UTC)", "frames", "s", "MiB", "verdict", box=None, padding=(0, 1))
    for item in found:
        try:
            meta = EvidenceMeta.model_validate(item)
        except ValidationError:
            continue  # of a later version
        table.add_row(
            printable(meta.id),
            printable(f"{meta.camera}/{meta.roi} {meta.alarm_class.value} {meta.sequence}"),
            f"{meta.time:%Y-%m-%d %H:%M:%S}",
            str(meta.frames),
            f"{meta.pre_roll_s:.1f} + {meta.post_roll_s:.1f}",
            f"{meta.size / (1 << 20):.1f}",
            printable(str(item.get("verdict") or "")),
        )
    Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else _WIDE).print(table)
    return 0


def _show(content: dict[str, Any]) -> int:
    _say(json.dumps(content, indent=2))
    return 0


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
