"""`lumpwatch events`: read the event log, also while the daemon writes it."""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from collections.abc import Iterator

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lumpwatch.service.cli.colours import change_style
from lumpwatch.service.cli.common import camera_of
from lumpwatch.service.config import load_config
from lumpwatch.service.core import moment_of, printable
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.storage import Event, EventLogError, event_file, merged_events

_COLUMNS = (
    "time", "monotonic_s", "camera", "roi", "class", "change", "before", "after", "actor", "reason",
    "existence", "frame", "id", "sequence", "evidence", "lip_s", "longest_mm",
)  # fmt: skip
_WIDE = 240
"""Columns of a table that goes to a file or a pipe: nothing is folded."""


def events(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=False)
    since_s = None if arguments.since is None else moment(arguments.since, time.time())
    chosen = [camera_of(config, arguments.camera)] if arguments.camera else config.cameras
    files = [event_file(config.store.path, camera.id) for camera in chosen]
    there = [file for file in files if file.is_file()]
    if not there:
        raise EventLogError(f"{files[0].parent}: holds no event log (nothing has happened yet?)")
    found = merged_events(there, since_s)
    {"table": _table, "jsonl": _jsonl, "csv": _csv}[arguments.format](found)
    return 0


def moment(text: str, now_s: float) -> float:
    """Seconds since the epoch of an ISO 8601 time, or of a span before `now_s`; raises ConfigError."""
    found_s = moment_of(text, now_s)
    if found_s is None:
        raise ConfigError(f"--since '{text}': is neither a time (2024-05-17T06:00) nor a span (12h)")
    return found_s


def _table(found: Iterator[Event]) -> None:
    table = Table("time (UTC)", "alarm", "no.", "change", "state", "by", "why", box=None, padding=(0, 1))
    for event in found:
        where = f"{event.camera}/{event.roi} {event.alarm_class.value}"
        when = f"{event.time:%Y-%m-%d %H:%M:%S}"
        table.add_row(
            when,
            printable(where),
            str(event.sequence),
            Text(event.change, change_style(event.alarm_class.value, event.change)),
            event.after,
            printable(event.actor or ""),
            printable(event.reason or ""),
        )
    width = None if sys.stdout.isatty() else _WIDE
    # Operators' words are words: square brackets in them are no mark-up.
    Console(highlight=False, markup=False, width=width).print(table)


def _jsonl(found: Iterator[Event]) -> None:
    for event in found:
        sys.stdout.write(json.dumps(event.public()) + "\n")


def _csv(found: Iterator[Event]) -> None:
    writer = csv.DictWriter(sys.stdout, _COLUMNS)
    writer.writeheader()
    for event in found:
        writer.writerow(event.public())
