"""Lumps, their largest size, blind time and the age of decisions, hour by hour: what drifts is seen here first."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.ages import HOUR_S
from lumpwatch.service.core import AlarmClass, Change, whole_number
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Event, Span, event_file, read_events, reading, uptime_spans

MOST_HOURS = 168
_SLACK_MIN = 2.0
"""What was watched is written down every now and then."""
Percentile = Callable[[tuple[str, str], int, float], float | None]


class TrendError(LumpwatchError):
    """What was asked for is no span of hours."""


@dataclass(slots=True)
class Hour:
    """An hour of a region."""

    begin_s: float
    lumps: int = 0
    largest_mm: float | None = None
    blind_min: float = 0.0
    watched_min: float = 0.0
    unknown: bool = False
    """Whether it was not watched all the time (so far): what is not told of it may have been."""
    age_ms: float | None = None
    """Of decisions: median."""
    late_ms: float | None = None
    """Of decisions: 99 in 100 were quicker."""


def hours_of(text: str) -> int:
    """How many hours are meant. Raises TrendError."""
    if not (hours := whole_number(text, MOST_HOURS)):
        raise TrendError(f"hours: '{text[:20]}' is not a number from 1 to {MOST_HOURS}")
    return hours


def trends(config: SiteConfig, hours: int, now_s: float, age: Percentile) -> list[dict[str, Any]]:
    """The last full and begun hours of each region, oldest first. Raises EventLogError for a log that is broken."""
    first = int(now_s // HOUR_S) - hours + 1
    found = []
    for camera in config.cameras:
        path = event_file(config.store.path, camera.id)
        rows = {roi.id: [Hour((first + i) * HOUR_S) for i in range(hours)] for roi in camera.rois}
        if path.is_file():
            _lumps(rows, first, read_events(path, first * HOUR_S))
            with reading(path) as db:
                for span in uptime_spans(db, first * HOUR_S, now_s):
                    _share(rows.get(span.roi, []), first, span)
        for roi, of_roi in rows.items():
            for i, hour in enumerate(of_roi):
                hour.unknown = hour.watched_min < min(now_s - hour.begin_s, HOUR_S) / 60 - _SLACK_MIN
                median, late = (age((camera.id, roi), first + i, share) for share in (0.5, 0.99))
                hour.age_ms = None if median is None else 1000 * median
                hour.late_ms = None if late is None else 1000 * late
            found.append({"camera": camera.id, "roi": roi, "logged": path.is_file(), "hours": of_roi})
    return found


def _lumps(rows: dict[str, list[Hour]], first: int, events: Iterable[Event]) -> None:
    for event in events:
        i = int(event.time_s // HOUR_S) - first
        raised = event.alarm_class is AlarmClass.LUMP and event.change == Change.RAISED
        if raised and event.roi in rows and 0 <= i < len(rows[event.roi]):
            hour = rows[event.roi][i]
            hour.lumps += 1
            size = event.details.get("longest_mm")
            if isinstance(size, float | int):
                hour.largest_mm = max(float(size), hour.largest_mm or 0.0)


def _share(hours: list[Hour], first: int, span: Span) -> None:
    """A span's times, spread over the hours that it touches by how much of it lies in each."""
    length = span.end_s - span.begin_s
    if length <= 0 or not hours:
        return
    low, high = math.floor(span.begin_s / HOUR_S), math.floor(span.end_s / HOUR_S)
    for number in range(max(low, first), min(high, first + len(hours) - 1) + 1):
        inside = min(span.end_s, (number + 1) * HOUR_S) - max(span.begin_s, number * HOUR_S)
        hour = hours[number - first]
        hour.blind_min += sum(span.blind_s.values()) * inside / length / 60
        hour.watched_min += inside / 60
