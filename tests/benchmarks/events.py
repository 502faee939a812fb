"""A log of millions of events: how long a start, a query, a report, an alarm and a step of retention take.

`python -m tests.benchmarks events 10000000`; it takes some 500 bytes of disk an event, in a temporary folder.
"""

from __future__ import annotations

import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import TypeVar

from lumpwatch.service.cli.demo import CAMERA, ROI, demo_config
from lumpwatch.service.config import parse_config
from lumpwatch.service.core import Alarm, AlarmClass
from lumpwatch.service.shift import read_shift, report_window, shift_figures
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.event_log_reader import read_events

T = TypeVar("T")
EVENTS = 10_000_000
DAYS = 365.0
"""Time over which the events are spread."""
NOW_S = 1_800_000_000.0
HOUR_S, SHIFT_S = 3600.0, 8 * 3600.0
STEPS, AT_ONCE = 20, 500


@dataclass(frozen=True, slots=True)
class Figure:
    """What was measured, in seconds, and what it should be at most."""

    what: str
    seconds: float
    goal_s: float


def run(count: int, folder: Path) -> list[Figure]:
    """Fill a log and measure."""
    path = event_file(folder, CAMERA)
    fill(path, count)
    figures = []
    log, took = _timed(lambda: _start(path))
    figures.append(Figure("start of the daemon: the file is checked and the state read", took, 120.0))
    last, took = _timed(lambda: sum(1 for _ in read_events(path, NOW_S - HOUR_S)))
    figures.append(Figure(f"query of the last hour ({last} events)", took, 2.0))
    config = parse_config(demo_config(folder, 0))
    window = report_window("2027-01-15T00:00/8h", config.shifts, NOW_S)
    records, took = _timed(lambda: read_shift(config, window))
    found, more = _timed(lambda: shift_figures(config.site, window, records, NOW_S))
    figures.append(Figure(f"report of a shift ({len(found['alarms'])} alarms)", took + more, 10.0))
    entries = [Entry(_event(count + k + 1, NOW_S + k), b"{}") for k in range(STEPS)]
    written = [_timed(partial(log.append, [entry]))[1] for entry in entries]
    figures.append(Figure("an alarm onto the disk, median", median(written), 0.25))
    steps = [_timed(lambda: log.prune(NOW_S - 30 * 86_400.0, 1_000_000, AT_ONCE)) for _ in range(STEPS)]
    assert all(removed > 0 for removed, _ in steps)
    figures.append(Figure(f"a step of retention ({AT_ONCE} rows), median", median(s for _, s in steps), 0.25))
    figures.append(Figure("the same, the slowest of twenty", max(s for _, s in steps), 1.0))
    log.close()
    return figures


def fill(path: Path, count: int) -> None:
    """So many events, evenly over the days before `NOW_S`, copied from one that was written as always."""
    log = EventLog(path)
    log.append([Entry(_event(1, NOW_S - DAYS * 86_400.0), b"{}")])
    log.published([(ROI, _name(1))])
    log.close()
    step_s = DAYS * 86_400.0 / count
    db = sqlite3.connect(path)
    db.execute("PRAGMA synchronous = OFF")
    db.execute(
        """WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n WHERE k < ?)
        INSERT INTO events (time_s, monotonic_s, clock, camera, roi, class, change, before, after, actor, reason,
            existence, frame, id, sequence, alarm, details)
        SELECT time_s + k * ?, monotonic_s + k * ?, clock, camera, roi, class, change, before, after, actor, reason,
            existence, frame + k, printf('%032x', k + 1), 1 + k, alarm, details FROM n, events WHERE number = 1""",
        (count - 1, step_s, step_s),
    )
    db.commit()
    db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    db.close()


def _start(path: Path) -> EventLog:
    log = EventLog(path, check=True)
    log.unpublished()
    log.records()
    log.latest()
    return log


def _name(k: int) -> str:
    return f"{k:032x}"


def _event(k: int, time_s: float) -> Event:
    return Event(
        time_s=time_s, monotonic_s=float(k), clock="boot", camera=CAMERA, roi=ROI, alarm_class=AlarmClass.LUMP,
        change="raised", before="NORMAL", after="UNACK_ACTIVE", actor=None, reason=None, existence=0.99, frame=k,
        id=_name(k), sequence=k, alarm=Alarm(), details={"longest_mm": 812.0},
    )  # fmt: skip


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    began = time.perf_counter()
    result = work()
    return result, time.perf_counter() - began


def main(arguments: list[str]) -> None:
    """Measure and print; exits where a goal is missed."""
    count = int(arguments[0]) if arguments else EVENTS
    with tempfile.TemporaryDirectory(prefix="lumpwatch-events-") as folder:
        figures = run(count, Path(folder))
    print(f"{count:,} events over {DAYS:.0f} days")
    for one in figures:
        print(f"  {one.what:70} {one.seconds:9.3f} s   goal {one.goal_s:g} s")
    if missed := [one.what for one in figures if one.seconds > one.goal_s]:
        sys.exit(f"missed: {'; '.join(missed)}")
