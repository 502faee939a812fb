"""Verdicts: what operators say of an alarm afterwards, by query to the running monitor."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from lumpwatch.service.bus import Handler
from lumpwatch.service.core import AlarmRequestError
from lumpwatch.service.protocol import Parameters, read, text_of
from lumpwatch.service.storage import EventLogError, EventWriter, Says, Verdict, raised_alarm, reading

_KNOWN = {"actor", "verdict", "alarm", "evidence", "note"}
_LONGEST_NOTE = 500


def verdict_on(path: Path, roi: str, parameters: Parameters, time_s: float) -> Verdict:
    """The verdict that is asked for, on an alarm that the event log at `path` knows.

    `alarm` is the sequence or id of one of its records, `evidence` the id of its evidence; without
    either the last alarm is meant. Raises AlarmRequestError.
    """
    if unknown := sorted(set(parameters) - _KNOWN):
        raise AlarmRequestError(f"{unknown[0]}: is no parameter of verdict (has {', '.join(sorted(_KNOWN))})")
    actor, says = text_of(parameters, "actor", 128), text_of(parameters, "verdict", 128)
    if says not in tuple(Says):
        raise AlarmRequestError(f"verdict: '{says}' is neither true, false nor unsure")
    if "alarm" in parameters and "evidence" in parameters:
        raise AlarmRequestError("alarm: is given as well as evidence; one of them is enough")
    wanted = parameters.get("alarm", parameters.get("evidence"))
    try:
        with reading(path) as db:
            found = raised_alarm(db, roi, wanted)
    except EventLogError as error:
        raise AlarmRequestError(str(error)) from error
    if found is None:
        raise AlarmRequestError(f"alarm: the event log knows no lump alarm {wanted or ''}".rstrip())
    note = " ".join(parameters.get("note", "").split())[:_LONGEST_NOTE] or None
    return Verdict(time_s, roi, *found, Says(says), actor, note)


def verdict_handler(
    path: Path, roi: str, events: EventWriter, wall: Callable[[], float], refused: Callable[[], None]
) -> Handler:
    """Answers the verdict queries of a ROI."""

    def handle(parameters: dict[str, str], payload: bytes | None) -> bytes:
        try:
            verdict = verdict_on(path, roi, read(parameters, payload), wall())
        except AlarmRequestError:
            refused()
            raise
        written = events.add((verdict,), wait=True)
        answer = {
            "verdict": verdict.says.value,
            "sequence": verdict.sequence,
            "alarm": verdict.id,
            "written": written,
        }
        return json.dumps(answer).encode()

    return handle
