"""Events and shifts: what the event log of the store says. Where the store is not on this host, that is said."""

from __future__ import annotations

import csv
import io
import math
import time
from collections import deque
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.times import SiteTimes
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.shift import Figures, read_shift, report_window, shift_figures
from lumpwatch.service.storage import Event, EventLogError, event_file, merged_events

MOST = 2000
COLUMNS = (
    "time", "camera", "roi", "class", "change", "before", "after", "actor", "reason", "existence", "sequence",
    "evidence", "lip_s", "longest_mm",
)  # fmt: skip


def events(config: SiteConfig, asked: Mapping[str, str], now_s: float | None = None) -> list[dict[str, Any]]:
    """The newest events that were asked for, newest first: `since`, `camera`, `class`, `change`, `actor`.

    Raises ConfigError for a time that is none and EventLogError where there is no log.
    """
    now_s = time.time() if now_s is None else now_s
    since_s = _moment(config, asked.get("since") or "24h", now_s)
    there = _logs(config, asked.get("camera") or "")
    found = merged_events(there, since_s)
    return [event.public() for event in reversed(deque(_wanted(found, asked), MOST))]


def as_csv(rows: list[dict[str, Any]]) -> str:
    """The same as CSV, oldest first; a text that a spreadsheet would take for a formula is quoted."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, extrasaction="ignore")
    writer.writeheader()
    for row in reversed(rows):
        writer.writerow({name: _harmless(value) for name, value in row.items()})
    return out.getvalue()


def shift(config: SiteConfig, when: str, now_s: float | None = None) -> Figures:
    """The figures of a shift. Raises ConfigError and EventLogError."""
    now_s = time.time() if now_s is None else now_s
    about = report_window(when, config.shifts, now_s)
    _logs(config)  # without any, nothing is known, and not that nothing happened
    return shift_figures(config.site, about, read_shift(config, about), now_s)


def by_hour(figures: Figures) -> list[int]:
    """Lumps in each hour of the shift."""
    begin = datetime.fromisoformat(figures["shift"]["begin"])
    counts = [0] * max(1, min(168, math.ceil(figures["shift"]["hours"])))
    for alarm in figures["alarms"]:
        hour = int((datetime.fromisoformat(alarm["time"]) - begin).total_seconds() // 3600)
        if 0 <= hour < len(counts):
            counts[hour] += 1
    return counts


def _logs(config: SiteConfig, only: str = "") -> list[Path]:
    """The event logs of all cameras, or of one. Raises EventLogError where there is none."""
    files = [event_file(config.store.path, one.id) for one in config.cameras if only in ("", one.id)]
    there = [file for file in files if file.is_file()]
    if not there:
        raise EventLogError(
            "there is no event log here: nothing has happened yet, or the store is on another host"
        )
    return there


def _wanted(found: Iterator[Event], asked: Mapping[str, str]) -> Iterator[Event]:
    for event in found:
        told = {"class": event.alarm_class.value, "change": event.change, "actor": event.actor or ""}
        if all(asked.get(name) in (None, "", value) for name, value in told.items()):
            yield event


def _moment(config: SiteConfig, text: str, now_s: float) -> float:
    found_s = SiteTimes(config).seconds_of(text, now_s)
    if found_s is None:
        raise ConfigError(f"since: '{text[:40]}' is neither a time (2024-05-17T06:00) nor a span (12h)")
    return found_s


def _harmless(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r") else value
