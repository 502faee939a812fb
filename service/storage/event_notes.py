"""What the event log holds beside the events: the uptime of a ROI, and people's verdicts on alarms."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from sqlite3 import Connection
from typing import ClassVar

from lumpwatch.service.protocol import VerdictOutcome as VerdictOutcome


@dataclass(frozen=True, slots=True)
class Verdict:
    """How someone judged an alarm; of several, the latest counts."""

    time_s: float
    """Wall clock, seconds since the epoch."""
    roi: str
    id: str
    """That of the record that raised the alarm, and of its evidence."""
    sequence: int
    """That of the same record."""
    outcome: VerdictOutcome
    actor: str
    note: str | None = None

    INSERT: ClassVar[str] = (
        "INSERT INTO verdicts (time_s, roi, id, sequence, verdict, actor, note) VALUES (?, ?, ?, ?, ?, ?, ?)"
    )

    def row(self) -> tuple[object, ...]:
        """As `INSERT` wants it."""
        return self.time_s, self.roi, self.id, self.sequence, self.outcome.value, self.actor, self.note


@dataclass(frozen=True, slots=True)
class Span:
    """A time in which the monitor watched a ROI; times between spans are times in which nobody did."""

    begin_s: float
    end_s: float
    """Wall clock, seconds since the epoch."""
    roi: str
    seen_s: float
    """For how much of it the ROI could judge."""
    blind_s: dict[str, float]
    """For how much it could not, by reason."""

    INSERT: ClassVar[str] = "INSERT INTO watched (begin_s, end_s, roi, seen_s, blind) VALUES (?, ?, ?, ?, ?)"

    def row(self) -> tuple[object, ...]:
        """As `INSERT` wants it."""
        return self.begin_s, self.end_s, self.roi, self.seen_s, json.dumps(self.blind_s)


Note = Verdict | Span


def verdicts(db: Connection) -> Iterator[Verdict]:
    """All of them, oldest first."""
    if _has(db, "verdicts"):
        query = "SELECT time_s, roi, id, sequence, verdict, actor, note FROM verdicts ORDER BY number"
        for time_s, roi, alarm, sequence, outcome, actor, note in db.execute(query):
            yield Verdict(time_s, roi, alarm, sequence, VerdictOutcome(outcome), actor, note)


def latest_verdicts(db: Connection) -> dict[tuple[str, str], Verdict]:
    """The one that counts, by ROI and alarm id."""
    return {(verdict.roi, verdict.id): verdict for verdict in verdicts(db)}


def uptime_spans(db: Connection, begin_s: float, end_s: float) -> Iterator[Span]:
    """Those that overlap with a time, in the order in which they were written."""
    if _has(db, "watched"):
        query = (
            "SELECT begin_s, end_s, roi, seen_s, blind FROM watched "
            "WHERE end_s > ? AND begin_s < ? ORDER BY number"
        )
        for begin, end, roi, seen_s, blind in db.execute(query, (begin_s, end_s)):
            yield Span(begin, end, roi, seen_s, dict(json.loads(blind)))


def raised_alarm(db: Connection, roi: str, wanted: str | None) -> tuple[str, int] | None:
    """Id and sequence of the lump alarm that a record belongs to: the last one raised up to it.

    `wanted` is the sequence or the id of the record; None: the last alarm of all.
    """
    last, arguments = "SELECT max(number) FROM events WHERE roi = ?", [roi]
    if wanted is not None:
        # An id has a hyphen; of a sequence that was used twice, after the log was lost, the later is meant.
        last += " AND class = 'lump' AND " + (
            "CAST(sequence AS TEXT) = ?" if wanted.isdecimal() else "id = ?"
        )
        arguments.append(wanted)
    (number,) = db.execute(last, arguments).fetchone()
    query = (
        "SELECT id, sequence FROM events WHERE roi = ? AND class = 'lump' AND change = 'raised' "
        "AND number <= ? ORDER BY number DESC LIMIT 1"
    )
    found = None if number is None else db.execute(query, (roi, number)).fetchone()
    return None if found is None else (str(found[0]), int(found[1]))


def _has(db: Connection, table: str) -> bool:
    """Whether the log is new enough; one that was never written since an update is not."""
    return bool(
        db.execute(
            "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = ?", (table,)
        ).fetchone()[0]
    )
