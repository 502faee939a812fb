"""What an event log may forget.

An event goes when it is older than the days allow, or when the log holds too many. What stays whatever
its age: the last event of each alarm (it is the alarm's state), and all since the raising of an alarm
that is active, latched or waits for acknowledgement.
"""

from __future__ import annotations

from collections.abc import Sequence
from sqlite3 import Connection

from lumpwatch.service.storage.event import Event


def prune(db: Connection, latest: Sequence[Event], before_s: float, most: int, at_once: int) -> int:
    """Delete at most `at_once` events older than `before_s`, or beyond the newest `most`; how many rows.

    `latest` is the last event of each ROI and class. Verdicts go with their alarm, spans of watching by
    age. To be called within a transaction.
    """
    newest, oldest = db.execute("SELECT max(number), min(number) FROM events").fetchone()
    horizon = 0
    if newest is not None:
        # The numbers rise without gaps while nothing is deleted, so this keeps `most` or a few less.
        (by_age,) = db.execute(
            "SELECT coalesce(min(number), ?) FROM events WHERE time_s >= ?", (newest + 1, before_s)
        ).fetchone()
        horizon = max(by_age, newest - most + 1)
    db.execute("UPDATE horizon SET number = max(number, ?), time_s = max(time_s, ?)", (horizon, before_s))
    kept = {number for event in latest for number in _needed(db, event)}
    removed = 0
    if newest is not None and oldest < horizon:
        marks = ", ".join(map(str, sorted(kept))) or "0"
        removed += db.execute(
            f"DELETE FROM events WHERE number IN (SELECT number FROM events WHERE number < ? "
            f"AND number NOT IN ({marks}) ORDER BY number LIMIT ?)",
            (horizon, at_once),
        ).rowcount
    removed += db.execute(
        "DELETE FROM verdicts WHERE time_s < ? AND NOT EXISTS "
        "(SELECT 1 FROM events WHERE events.roi = verdicts.roi AND events.id = verdicts.id)",
        (before_s,),
    ).rowcount
    removed += db.execute(
        "DELETE FROM watched WHERE number IN (SELECT number FROM watched WHERE end_s < ? LIMIT ?)",
        (before_s, at_once),
    ).rowcount
    return removed


def _needed(db: Connection, last: Event) -> list[int]:
    """Numbers of the events of an alarm that must stay."""
    of_alarm = (last.roi, last.alarm_class.value)
    (newest,) = db.execute("SELECT max(number) FROM events WHERE roi = ? AND class = ?", of_alarm).fetchone()
    alarm = last.alarm
    if not (alarm.active or alarm.waits or alarm.latched or alarm.held):
        return [int(newest)]
    (raised,) = db.execute(
        "SELECT max(number) FROM events WHERE roi = ? AND class = ? AND change IN ('raised', 'active')",
        of_alarm,
    ).fetchone()
    query = "SELECT number FROM events WHERE roi = ? AND class = ? AND number >= ?"
    return [int(row[0]) for row in db.execute(query, (*of_alarm, newest if raised is None else raised))]
