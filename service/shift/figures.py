"""The figures of a shift, as plain data for JSON.

Availability is the share of the shift in which a ROI could see. Time outside all uptime spans (the daemon was
down) is unknown, and counts as not seen. Precision is true / (true + false) over the judged alarms, with
the exact interval of Clopper and Pearson. Rates are held against EEMUA 191: for one operator, in the
steady state, at most one alarm in ten minutes is very likely acceptable, and more than ten in ten
minutes are a flood.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from statistics import median
from typing import Any

from lumpwatch.service.shift.record import AlarmStory, RoiRecord
from lumpwatch.service.shift.window import Window
from lumpwatch.service.storage import Span, VerdictOutcome

Figures = dict[str, Any]

TEN_MINUTES_S = 600.0
FLOOD = 10
_BANDS = (
    (1.0, "very likely acceptable"),
    (2.0, "manageable"),
    (10.0, "likely to be over-demanding"),
    (math.inf, "very likely unacceptable"),
)
"""Alarms in ten minutes, long-term average for one operator, up to which EEMUA 191 finds so."""


def shift_figures(site: str, window: Window, records: Sequence[RoiRecord], generated_s: float) -> Figures:
    """Everything that the report states."""
    alarms = sorted(
        (alarm for record in records for alarm in record.alarms), key=lambda alarm: alarm.raised.time_s
    )
    return {
        "site": site,
        "shift": {
            "name": window.name,
            "begin": _iso(window.begin_s),
            "end": _iso(window.end_s),
            "hours": round(window.lasts_s / 3600, 4),
        },
        "generated": _iso(generated_s),
        "total": _of_alarms(alarms, _watched_h(records, window))
        | {
            "held": sum(record.held for record in records),
            "blind_alarms": sum(record.blind_alarms for record in records),
        },
        "rates": _rates(records, window),
        "rois": [_of_roi(record, window) for record in records],
        "alarms": [_alarm_figures(alarm) for alarm in alarms],
    }


def _of_roi(record: RoiRecord, window: Window) -> Figures:
    seen_s, blind_s = uptime(record.spans, window)
    known_s = seen_s + sum(blind_s.values())
    return {
        "camera": record.place[0],
        "roi": record.place[1],
        **_of_alarms(record.alarms, seen_s / 3600),
        "held": record.held,
        "blind_alarms": record.blind_alarms,
        "availability": round(min(seen_s / window.lasts_s, 1.0), 6),
        "blind_minutes": {reason: round(time_s / 60, 3) for reason, time_s in sorted(blind_s.items())},
        "unknown_minutes": round(max(window.lasts_s - known_s, 0.0) / 60, 3),
    }


def _watched_h(records: Sequence[RoiRecord], window: Window) -> float:
    """Hours that a region was watched, on average."""
    return sum(uptime(record.spans, window)[0] for record in records) / 3600 / max(len(records), 1)


def _of_alarms(alarms: Sequence[AlarmStory], watched_h: float) -> Figures:
    announced = len(alarms) + sum(len(alarm.again) for alarm in alarms)
    counts = Counter(None if alarm.verdict is None else alarm.verdict.outcome for alarm in alarms)
    true, judged = counts[VerdictOutcome.TRUE], counts[VerdictOutcome.TRUE] + counts[VerdictOutcome.FALSE]
    acknowledged = [alarm.acknowledged_after_s for alarm in alarms]
    return {
        "lumps": len(alarms),
        "announcements": announced,
        "watched_hours": round(watched_h, 4),
        "alarms_per_hour": round(announced / watched_h, 4) if watched_h > 0 else None,
        "longest_mm": _spread(alarm.number("longest_mm") for alarm in alarms),
        "warning_s": _spread((alarm.number("lip_s") for alarm in alarms), worst=min),
        "acknowledge_s": _spread(acknowledged),
        "unacknowledged": sum(delay_s is None for delay_s in acknowledged),
        "verdicts": {outcome.value: counts[outcome] for outcome in VerdictOutcome} | {"none": counts[None]},
        "precision": round(true / judged, 6) if judged else None,
        "precision_interval": [round(end, 6) for end in _interval(true, judged)],
    }


def _interval(true: int, judged: int) -> tuple[float, float]:
    """Of the precision; anything is possible where nothing was judged."""
    if not judged:
        return 0.0, 1.0
    from lumpwatch.models.intervals import binomial_interval  # loads SciPy, which no console needs at rest

    return binomial_interval(true, judged)


def uptime(spans: Iterable[Span], window: Window) -> tuple[float, dict[str, float]]:
    """Seconds seen, and blind by reason, within a window.

    A span that reaches over the edge counts in proportion. Where spans overlap (the wall clock was put
    back), the time counts once: the earlier span has it.
    """
    seen_s, covered_s = 0.0, window.begin_s
    blind_s: dict[str, float] = {}
    for span in sorted(spans, key=lambda span: (span.begin_s, span.end_s)):
        begin_s, end_s = max(span.begin_s, covered_s), min(span.end_s, window.end_s)
        if end_s <= begin_s:
            continue
        share = (end_s - begin_s) / (span.end_s - span.begin_s)
        seen_s += share * span.seen_s
        for reason, time_s in span.blind_s.items():
            blind_s[reason] = blind_s.get(reason, 0.0) + share * time_s
        covered_s = end_s
    return seen_s, blind_s


def _rates(records: Sequence[RoiRecord], window: Window) -> Figures:
    """What one operator hears of all ROIs, blind alarms apart."""
    times = sorted(
        event.time_s
        for record in records
        for alarm in record.alarms
        for event in (alarm.raised, *alarm.again)
        if event.time_s < window.end_s
    )
    counts = in_ten_minutes(times, window)
    watched_s = 3600 * _watched_h(records, window) or window.lasts_s
    mean = len(times) / max(watched_s / TEN_MINUTES_S, 1e-9)
    return {
        "ten_minutes_mean": round(mean, 4),
        "ten_minutes_peak": max(counts, default=0),
        "flood_share": round(sum(count > FLOOD for count in counts) / max(len(counts), 1), 6),
        "eemua_191": next(text for most, text in _BANDS if mean <= most),
    }


def in_ten_minutes(times: Iterable[float], window: Window) -> list[int]:
    """Alarms in each ten minutes of the window, the last one perhaps shorter."""
    counts = [0] * math.ceil(window.lasts_s / TEN_MINUTES_S)
    for time_s in times:
        counts[int((time_s - window.begin_s) // TEN_MINUTES_S)] += 1
    return counts


def _spread(values: Iterable[float | None], worst: Any = max) -> Figures:
    """Number, median and worst of the known values."""
    known = sorted(value for value in values if value is not None)
    if not known:
        return {"count": 0, "median": None, "worst": None, "values": []}
    return {
        "count": len(known),
        "median": round(median(known), 3),
        "worst": round(worst(known), 3),
        "values": [round(value, 3) for value in known],
    }


def _alarm_figures(story: AlarmStory) -> Figures:
    raised, verdict = story.raised, story.verdict
    return {
        "time": _iso(raised.time_s),
        "camera": raised.camera,
        "roi": raised.roi,
        "sequence": raised.sequence,
        "id": raised.id,
        "existence": raised.existence,
        "longest_mm": story.number("longest_mm"),
        "warning_s": story.number("lip_s"),
        "acknowledged_s": _rounded(story.acknowledged_after_s),
        "acknowledged_by": None if story.acknowledged is None else story.acknowledged.actor,
        "lasted_s": _rounded(story.lasted_s),
        "verdict": None if verdict is None else verdict.outcome.value,
        "verdict_by": None if verdict is None else verdict.actor,
        "note": None if verdict is None else verdict.note,
        "evidence": story.evidence,
        "announced_again": len(story.again),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _iso(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="seconds")
