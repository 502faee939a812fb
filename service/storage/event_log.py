"""The event log of one camera: every transition and every operator action, append-only, in SQLite.

    <store>/events/<camera>.sqlite

WAL with synchronous FULL: what `append` returned from is there after a power cut. Each row holds the
alarm as it was after the event, so the last row of a ROI and class is the state to start with. Records
lie in an outbox until they were published, so that none is lost between the disk and the bus. Triggers
refuse to change or delete an event.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from lumpwatch.service.core import Alarm, AlarmClass, Hold
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_log_schema import FROM_VERSION_1, SCHEMA, VERSION
from lumpwatch.service.storage.event_notes import Note
from lumpwatch.service.storage.retention import prune

_CORRUPT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
BUSY_S = 1.0
_PAGES_AT_ONCE = 256
"""Of 4 KiB, that are given back to the disk after a pruning: a long wait would hold up an alarm."""

# Not part of the log: the last records as they went out, for who joins the bus after a restart.
_RECORDS = """
CREATE TABLE IF NOT EXISTS records (
    roi TEXT NOT NULL, class TEXT NOT NULL, id TEXT NOT NULL,
    publisher TEXT NOT NULL, number INTEGER NOT NULL, record BLOB NOT NULL, UNIQUE (roi, id)
) STRICT;
"""
_PRUNE = """
DELETE FROM records WHERE roi = :roi
AND rowid NOT IN (SELECT rowid FROM records WHERE roi = :roi ORDER BY rowid DESC LIMIT :most)
AND rowid NOT IN (SELECT max(rowid) FROM records WHERE roi = :roi GROUP BY class)
"""
RECORDS_KEPT = 64
"""How many records of a ROI are kept; the last one of each class stays beyond that."""
_COLUMNS = (
    "time_s", "monotonic_s", "clock", "camera", "roi", "class", "change", "before", "after",
    "actor", "reason", "existence", "frame", "id", "sequence", "alarm", "details",
)  # fmt: skip
_FIELDS = tuple(field.name for field in fields(Event))
# A commit whose success is not known is tried again: the same event is still one row.
_INSERT = (
    f"INSERT INTO events ({', '.join(_COLUMNS)}) VALUES ({', '.join('?' * len(_COLUMNS))}) "
    "ON CONFLICT (roi, id) DO NOTHING"
)
SELECT = f"SELECT {', '.join(_COLUMNS)} FROM events"
SELECT_1 = f"SELECT {', '.join(_COLUMNS[:-1])}, NULL FROM events"
"""Of a log that no daemon of this version has opened yet."""


class EventLogError(LumpwatchError):
    """The event log cannot be read; the text names the file."""


@dataclass(frozen=True, slots=True)
class Entry:
    """An event with its record for the bus."""

    event: Event
    record: bytes
    publisher: str = ""
    """Name of the publisher that sends it."""


@dataclass(frozen=True, slots=True)
class KeptRecord:
    """A record as it went out."""

    roi: str
    id: str
    publisher: str
    number: int
    """Its sequence."""
    record: bytes


def event_file(store: Path, camera: str) -> Path:
    """Where the event log of a camera lies."""
    return store / "events" / f"{camera}.sqlite"


def is_corrupt(error: Exception) -> bool:
    """Whether the file itself is damaged, or is none of ours, and not only out of reach for now."""
    code = getattr(error, "sqlite_errorcode", None)
    # SQLite's own words hold what it has found in the file, which is no text then.
    foreign = isinstance(error, (_Foreign, UnicodeDecodeError))
    return foreign or (code is not None and code & 0xFF in _CORRUPT)


_REFUSED = (
    sqlite3.SQLITE_CONSTRAINT,
    sqlite3.SQLITE_MISMATCH,
    sqlite3.SQLITE_TOOBIG,
    sqlite3.SQLITE_RANGE,
)


def is_refused(error: Exception) -> bool:
    """Whether the values themselves cannot be written, to this file or any other."""
    if isinstance(error, sqlite3.Error):
        code = getattr(error, "sqlite_errorcode", None)
        return "bind" in str(error) if code is None else code & 0xFF in _REFUSED
    # Before SQLite sees them: text with half a surrogate pair, a number beyond 64 bits.
    return isinstance(error, (ValueError, TypeError, OverflowError)) and not is_corrupt(error)


_NOWHERE = (0, 0)


def _identity(path: Path) -> tuple[tuple[int, int], tuple[int, int]]:
    """Device and number of the file and of its journal. Raises OSError."""
    return _place(path), _place(path.with_name(f"{path.name}-wal"))


def _place(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return _NOWHERE
    return status.st_dev, status.st_ino


class _Foreign(sqlite3.DatabaseError):
    """A database that is not an event log of this version."""


class EventLog:
    """An open event log; all methods raise sqlite3.Error, `__init__` also OSError."""

    def __init__(self, path: Path, *, check: bool = True) -> None:
        """Open the file, made where missing; `check` reads it all for damage first."""
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        # One thread at a time uses it: the one that opens it, then the writer.
        self._db = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
        try:
            self._prepare(check=check)
        except BaseException:
            self._db.close()
            raise

    def _prepare(self, *, check: bool) -> None:
        version = self._db.execute("PRAGMA user_version").fetchone()[0]
        new = version == 0 and self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
        if version not in (1, VERSION) and not new:
            raise _Foreign(f"is of version {version}, expected {VERSION}")
        if new:
            self._db.execute("PRAGMA auto_vacuum = INCREMENTAL")
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")
        if check and (problem := self._db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
            raise _Foreign(problem)
        if new:
            self._db.executescript(SCHEMA)
        elif version == 1:
            self._db.executescript(FROM_VERSION_1)
            self._db.execute("PRAGMA auto_vacuum = INCREMENTAL")
            self._db.execute("VACUUM")
        self._db.execute(_RECORDS)
        self._identity = _identity(self._path)

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    def in_place(self) -> bool:
        """Whether the file, with its journal, still lies where it was opened. Raises OSError."""
        file, journal = _identity(self._path)
        if self._identity[1] == _NOWHERE:  # it comes with the first access
            self._identity = (self._identity[0], journal)
        return self._identity == (file, journal)

    def checkpoint(self) -> None:
        """Bring what the journal holds into the file."""
        self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def put_back(self) -> None:
        """Write all that the removed file holds to its old place; it can be read as long as it is open."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        for suffix in ("-wal", "-shm"):
            self._path.with_name(self._path.name + suffix).unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(self._path, timeout=BUSY_S)) as new:
            self._db.backup(new)

    def append(self, entries: Collection[Entry]) -> None:
        """Write events and their records, all or none; they are on the disk when this returns."""
        with self._transaction():
            for entry in entries:
                self._db.execute(_INSERT, _row(entry.event))
                self._db.execute(
                    "INSERT INTO outbox VALUES (?, ?, ?) ON CONFLICT DO NOTHING",
                    (entry.event.roi, entry.event.id, entry.record),
                )
                self._db.execute(
                    "INSERT INTO records VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
                    (
                        entry.event.roi,
                        entry.event.alarm_class.value,
                        entry.event.id,
                        entry.publisher,
                        entry.event.sequence,
                        entry.record,
                    ),
                )
            for roi in {entry.event.roi for entry in entries}:
                self._db.execute(_PRUNE, {"roi": roi, "most": RECORDS_KEPT})
        # Nothing is kept in memory, so damage to the file shows with the next event, not the next start.
        self._db.execute("PRAGMA shrink_memory")

    def records(self) -> list[KeptRecord]:
        """The last records of each ROI, oldest first."""
        rows = self._db.execute("SELECT roi, id, publisher, number, record FROM records ORDER BY rowid")
        return [KeptRecord(*row) for row in rows]

    def copy(self, events: Iterable[Event]) -> None:
        """Write events whose records were published long ago: those that a damaged file held."""
        with self._transaction():
            self._db.executemany(_INSERT, map(_row, events))

    def published(self, sent: Iterable[tuple[str, str]]) -> None:
        """The records of these (ROI, id) are on the bus."""
        with self._transaction():
            self._db.executemany("DELETE FROM outbox WHERE roi = ? AND id = ?", sent)

    def add(self, notes: Iterable[Note]) -> None:
        """Write spans of watching and verdicts, all or none; they are on the disk when this returns."""
        with self._transaction():
            for note in notes:
                self._db.execute(note.INSERT, note.row())

    def prune(self, before_s: float, most: int, at_once: int) -> int:
        """Forget what is over, acknowledged and older, or too much; how many rows went. See `retention`."""
        with self._transaction():
            removed = prune(self._db, self.latest(), before_s, most, at_once)
        # `execute` would give back a single page: it does not step through statements without rows.
        self._db.executescript(f"PRAGMA incremental_vacuum({_PAGES_AT_ONCE})")
        return removed

    def unpublished(self) -> list[tuple[str, str, bytes]]:
        """ROI, id and record of those that may not be on the bus, oldest first."""
        return self._db.execute("SELECT roi, id, record FROM outbox ORDER BY rowid").fetchall()

    def latest(self) -> list[Event]:
        """The last event of each ROI and class; what cannot be understood is damage."""
        numbers = "SELECT max(number) FROM events GROUP BY roi, class"
        rows = self._db.execute(f"{SELECT} WHERE number IN ({numbers}) ORDER BY number").fetchall()
        try:
            return [event_of(row) for row in rows]
        except (ValueError, TypeError, KeyError) as error:
            raise _Foreign(f"holds an event that is none of ours ({error})") from error

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):  # some errors have ended it already
                self._db.execute("ROLLBACK")
            raise


def _row(event: Event) -> tuple[object, ...]:
    """In the order of `_COLUMNS`, which is that of the fields."""
    return (
        event.time_s, event.monotonic_s, event.clock, event.camera, event.roi, event.alarm_class.value,
        event.change, event.before, event.after, event.actor, event.reason, event.existence, event.frame,
        event.id, event.sequence, alarm_text(event.alarm), json.dumps(event.details) if event.details else None,
    )  # fmt: skip


def event_of(row: tuple[Any, ...]) -> Event:
    """A row of `SELECT`; raises ValueError, TypeError or KeyError for anything else."""
    values = list(row)
    values[5], values[15] = AlarmClass(values[5]), alarm_of(values[15])
    values[16] = {} if values[16] is None else dict(json.loads(values[16]))
    return Event(**dict(zip(_FIELDS, values, strict=True)))


def alarm_text(alarm: Alarm) -> str:
    """An alarm as JSON; what is empty is left out, and so is the delay that was running."""
    empty = asdict(Alarm())
    kept = {name: value for name, value in asdict(alarm).items() if value != empty[name]}
    kept.pop("since_s", None)
    return json.dumps(kept, separators=(",", ":"))


def alarm_of(text: str) -> Alarm:
    """The reverse of `alarm_text`; raises ValueError or TypeError for anything else."""
    fields = json.loads(text)
    for kind in ("shelved", "out_of_service"):
        if kind in fields:
            fields[kind] = Hold(**fields[kind])
    if "suppressed" in fields:
        fields["suppressed"] = tuple(Hold(**hold) for hold in fields["suppressed"])
    return Alarm(**fields)
