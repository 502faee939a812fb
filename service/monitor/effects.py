"""What a change of an alarm sets off in the world, as values: planned, compared in tests, then carried out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lumpwatch.service.core import AlarmClass, Transition
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.monitor.alarm_record import AlarmRecord
from lumpwatch.service.storage import Entry


@dataclass(frozen=True, slots=True)
class KeepEvidence:
    """Begin the evidence of an alarm."""

    trigger: Trigger


@dataclass(frozen=True, slots=True)
class Write:
    """Write to the event log; waited for, as long as the disk is well."""

    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True)
class Publish:
    """Send a record on the alarm key of its ROI."""

    entry: Entry


@dataclass(frozen=True, slots=True)
class Count:
    """Count a change, and log it."""

    roi: str
    alarm_class: AlarmClass
    transition: Transition
    existence: float
    frame: int


@dataclass(frozen=True, slots=True)
class Confirm:
    """The records of these (ROI, id) were put on the bus."""

    records: tuple[tuple[str, str], ...]


Effect = KeepEvidence | Write | Publish | Count | Confirm


def effects_of(records: Sequence[AlarmRecord]) -> tuple[Effect, ...]:
    """In the order that keeps the promise: in the event log before it is on the bus."""
    if not records:
        return ()
    entries = tuple(record.entry for record in records)
    return (
        *(KeepEvidence(record.trigger) for record in records if record.trigger is not None),
        Write(entries),
        *(Publish(entry) for entry in entries),
        *(
            Count(
                record.entry.event.roi,
                record.alarm_class,
                record.transition,
                record.entry.event.existence,
                record.entry.event.frame,
            )
            for record in records
        ),
        Confirm(tuple((entry.event.roi, entry.event.id) for entry in entries)),
    )
