"""Reads event logs, also while a daemon writes them, and what is left of damaged ones."""

from __future__ import annotations

import contextlib
import heapq
import logging
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path

from lumpwatch.service.storage.cannot_open import cause_of
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_log import (
    BUSY_S,
    SELECT,
    SELECT_1,
    EventLogError,
    event_of,
    is_corrupt,
)

log = logging.getLogger(__name__)

_NO_EVENT = (ValueError, TypeError, KeyError)
_MOST_UNREADABLE = 100_000


def merged_events(paths: Iterable[Path], since_s: float | None = None) -> Iterator[Event]:
    """Those of several files, oldest first; see `read_events`."""
    return heapq.merge(*(read_events(path, since_s) for path in paths), key=lambda event: event.time_s)


def read_events(path: Path, since_s: float | None = None) -> Iterator[Event]:
    """All events since a wall-clock time, oldest first, also while a daemon writes them.

    Opens the file read-only. Raises EventLogError.
    """
    since = "" if since_s is None else "WHERE time_s >= ?"
    arguments = () if since_s is None else (since_s,)
    with reading(path) as db:
        (version,) = db.execute("PRAGMA user_version").fetchone()
        select = SELECT_1 if version == 1 else SELECT
        last = 0
        try:
            for row in db.execute(f"{_numbered(select)} {since} ORDER BY number", arguments):
                event = event_of(row[1:])
                last = row[0]
                yield event
        except (sqlite3.DatabaseError, *_NO_EVENT) as error:
            # Text that is not UTF-8 has no code.
            coded = getattr(error, "sqlite_errorcode", None) is not None
            if isinstance(error, sqlite3.DatabaseError) and coded and not is_corrupt(error):
                raise
        else:
            return
        yield from _what_can_be_read(db, path, select, last, since_s)


def _numbered(select: str) -> str:
    return select.replace("SELECT ", "SELECT number, ", 1)


def _what_can_be_read(
    db: sqlite3.Connection, path: Path, select: str, last: int, since_s: float | None
) -> Iterator[Event]:
    """The events after the number `last` of a damaged file, each by itself; what cannot be read is told."""
    unreadable = gap = 0
    number = last
    try:
        (most,) = db.execute("SELECT seq FROM sqlite_sequence WHERE name = 'events'").fetchone()
    except (sqlite3.Error, TypeError):
        most = last + _MOST_UNREADABLE
    while number < most and gap < _MOST_UNREADABLE:
        number += 1
        try:
            row = db.execute(f"{select} WHERE number = ?", (number,)).fetchone()
            event = None if row is None else event_of(row)
        except (sqlite3.DatabaseError, *_NO_EVENT):
            unreadable += 1
            gap += 1
            continue
        if event is None:
            gap += 1
        else:
            gap = 0
            if since_s is None or event.time_s >= since_s:
                yield event
    log.error(
        "event log %s is damaged: %d rows cannot be read, the others are shown", path, max(unreadable, 1)
    )


@contextlib.contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """The file open for reading only. Raises EventLogError for whatever goes wrong within, too."""
    if not path.is_file():
        raise EventLogError(f"{path}: there is no event log (nothing has happened yet, or another store)")
    # Without a journal nobody writes, and a folder that cannot be written could not take one either.
    mode = "mode=ro" if path.with_name(path.name + "-wal").exists() else "mode=ro&immutable=1"
    try:
        db = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, timeout=BUSY_S)
        with contextlib.closing(db):
            yield db
    except (sqlite3.Error, ValueError, KeyError, TypeError) as error:
        raise EventLogError(f"{path}: cannot be read ({cause_of(error, path)})") from error
