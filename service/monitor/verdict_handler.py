"""Verdicts: how operators judge an alarm afterwards, by query to the running monitor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lumpwatch.service.core import AlarmRequestError
from lumpwatch.service.protocol import VerdictReply, VerdictRequest
from lumpwatch.service.storage import EventLogError, EventWriter, Verdict, raised_alarm, reading


def verdict_on(path: Path, roi: str, request: VerdictRequest, time_s: float) -> Verdict:
    """The verdict that is asked for, on an alarm that the event log at `path` knows. Raises AlarmRequestError."""
    wanted = request.evidence if request.alarm is None else str(request.alarm)
    try:
        with reading(path) as db:
            found = raised_alarm(db, roi, wanted)
    except EventLogError as error:
        raise AlarmRequestError(str(error)) from error
    if found is None:
        raise AlarmRequestError(f"alarm: the event log knows no lump alarm {wanted or ''}".rstrip())
    return Verdict(time_s, roi, *found, request.verdict, request.actor, request.note or None)


def verdict_handler(
    path: Path, events: EventWriter, wall: Callable[[], float]
) -> Callable[[str, VerdictRequest], bytes]:
    """Answers the verdict requests on a ROI."""

    def handle(roi: str, request: VerdictRequest) -> bytes:
        verdict = verdict_on(path, roi, request, wall())
        written = events.add((verdict,), wait=True)
        return VerdictReply(
            verdict=verdict.outcome, sequence=verdict.sequence, alarm=verdict.id, written=written
        ).line()

    return handle
