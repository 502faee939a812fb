"""One change of an alarm as a finished record: what the event log keeps and the bus sends, already in bytes.

Pure. A record that cannot be written raises here, while the alarm is still what it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lumpwatch.service.core import (
    AlarmChange,
    AlarmClass,
    AlarmRequestError,
    Change,
    Clocks,
    RoiResult,
    Transition,
)
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.protocol import AlarmData, Latency, alarm_event, record_id
from lumpwatch.service.storage import Details, Entry, Event


class RecordError(AlarmRequestError):
    """A change of an alarm cannot be recorded, so it must not happen; the text names ROI and change."""


@dataclass(frozen=True, slots=True)
class Source:
    """Whose records they are."""

    site: str
    camera: str
    clock: str
    """Name of this host's monotonic clock."""


@dataclass(frozen=True, slots=True)
class AlarmRecord:
    """One change of an alarm, and what it sets off."""

    alarm_class: AlarmClass
    transition: Transition
    entry: Entry
    """For the event log and the bus."""
    trigger: Trigger | None
    """What begins the evidence of an alarm that was raised."""


def finish(
    result: RoiResult,
    change: AlarmChange,
    *,
    source: Source,
    sequence: int,
    clocks: Clocks,
    publisher: str = "",
    latency: Latency | None = None,
    largest_lump: Details | None = None,
    evidence: Callable[[Trigger], bool] = lambda _: False,
) -> AlarmRecord:
    """The record of a change in a result. Raises RecordError.

    `publisher` is the name of the one that sends it, `largest_lump` what is known of the largest lump, and
    `evidence` says whether there will be evidence of an alarm that was raised.
    """
    transition, name, trigger = change.transition, record_id(clocks, sequence), None
    if transition.change is Change.RAISED:
        trigger = Trigger(name, result.roi, change.alarm_class, sequence, clocks.wall_s, clocks.monotonic_s)
    try:
        made = alarm_event(
            result,
            change,
            source.site,
            source.camera,
            sequence,
            clocks,
            latency=latency,
            evidence=name if trigger is not None and evidence(trigger) else None,
        )
        line = made.line()
    except ValueError as error:
        raise RecordError(
            f"{source.camera}/{result.roi}: {change.alarm_class.value} alarm {transition.change.value}: "
            "cannot be recorded, so it is not done (its text is not UTF-8)"
        ) from error
    event = Event(
        time_s=clocks.wall_s,
        monotonic_s=clocks.monotonic_s,
        clock=source.clock,
        camera=source.camera,
        roi=result.roi,
        alarm_class=change.alarm_class,
        change=transition.change.value,
        before=transition.before.value,
        after=transition.after.value,
        actor=transition.actor,
        reason=transition.reason,
        existence=made.data.existence,
        frame=made.data.frame,
        id=made.id,
        sequence=made.data.sequence,
        alarm=change.alarm,
        details=_details(made.data, largest_lump or {}),
    )
    return AlarmRecord(change.alarm_class, transition, Entry(event, line, publisher), trigger)


def _details(data: AlarmData, largest_lump: Details) -> Details:
    """What reports want to know of a change beside the alarm's own columns."""
    found: Details = {"lip_s": data.lip_s, "evidence": data.evidence}
    if data.alarm_class is AlarmClass.LUMP:
        found |= largest_lump
    return {name: value for name, value in found.items() if value is not None}
