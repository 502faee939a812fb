"""Writes the event log of one camera in a thread of its own, so that no disk can hold up the filter.

`write` hands over a batch and waits until it is on the disk, but for `WAIT_S` at the most: an alarm is
on the disk before it is on the bus, unless the disk is in trouble. While it is, `write` does not wait at
all; batches wait in memory, up to `MOST_WAITING` events, and are written once the disk takes them again.
A file that was removed while it was open is put back where it was, with all that it held; one that was replaced by
another goes on with the present state. What nobody has thought of ends no thread: it is logged, counted (`failed`),
and the batch set aside. `trouble` says whether alarms are not being recorded, or were not a moment ago.
A damaged file is moved aside under a name of its own and a new one begins, with the present state. Damage is
what SQLite calls so, and what was read and is none of ours. A row whose values no file would take is set aside
alone: it is counted and named in the log, and all others are written.
"""

from __future__ import annotations

import contextlib
import logging
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from lumpwatch.service.core import Alarm, AlarmClass
from lumpwatch.service.storage.cannot_open import cause_of
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_batch import Batch
from lumpwatch.service.storage.event_log import (
    Entry,
    EventLog,
    EventLogError,
    KeptRecord,
    event_file,
    is_corrupt,
    is_refused,
)
from lumpwatch.service.storage.event_log_reader import read_events
from lumpwatch.service.storage.event_notes import Note

log = logging.getLogger(__name__)

WAIT_S = 0.25
RETRY_S = 5.0
LOOK_S = 2.0
"""How often an idle log looks whether its file is still where it was."""
TOLD_S = 30.0
"""So long after a problem of the log its trouble stands."""
_MOST_ABANDONED = 8
_TROUBLES = ("corrupt", "unwritable", "lost", "refused", "removed", "replaced", "failed")
MOST_WAITING = 10_000
_CLOSE_S = 1.5
PRUNE_EVERY_S = 3600.0
PRUNE_AT_ONCE = 500
"""Rows that retention removes before it looks whether an alarm waits."""


class EventObserver(Protocol):
    """Counts what happens to the log; implemented by metrics."""

    def events_written(self, count: int) -> None:
        """Events are on the disk."""

    def event_problem(self, reason: str, count: int = 1) -> None:
        """`corrupt`, `unwritable`, `late`, `lost`, `refused`, `removed`, `replaced` or `failed`."""

    def events_waiting(self, count: int) -> None:
        """Events that are not on the disk yet."""

    def events_removed(self, count: int) -> None:
        """Rows that retention has removed."""


@dataclass(frozen=True, slots=True)
class Retention:
    """What the log keeps of what is over and acknowledged."""

    days: float
    events: int


class EventWriter:
    """The log of one camera: what it held at the start, and the way to write more."""

    def __init__(
        self,
        store: Path,
        camera: str,
        observer: EventObserver,
        wall: Callable[[], float],
        *,
        retry_s: float = RETRY_S,
        most_waiting: int = MOST_WAITING,
        open_log: Callable[[Path, bool], EventLog] = lambda path, check: EventLog(path, check=check),
        retention: Retention | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Opens and reads the log; never raises for what is wrong with it."""
        self._path = event_file(store, camera)
        self._observer = observer
        self._wall = wall
        self._retry_s = retry_s
        self._most_waiting = most_waiting
        self._open_log = open_log
        self._retention = retention
        self._log: EventLog | None = None
        self._abandoned: deque[EventLog] = deque(maxlen=_MOST_ABANDONED)
        self._clock = clock
        self._trouble_s: float | None = None
        self._pruned_s = clock() - PRUNE_EVERY_S
        self._last_problem = ""
        self._latest: dict[tuple[str, AlarmClass], Event] = {}
        self.unpublished: list[tuple[str, str, bytes]] = []
        """ROI, id and record of what may not have come on the bus before the last end."""
        self.records: list[KeptRecord] = []
        """The last records of each ROI that were written before the last end, oldest first."""
        if not self._attempt(self._start):
            self._start_reading()
        self._first = dict(self._latest)
        self._removed = 0
        self._batches: deque[Batch] = deque()
        self._waiting = 0
        self._ill = self._log is None
        self._wake = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="event log", daemon=True)
        self._thread.start()

    def alarms(self, monotonic_s: float, wall_s: float, clock: str) -> dict[tuple[str, AlarmClass], Alarm]:
        """The alarms as the log had them at the start, times carried over to the clock of now."""
        return {key: event.alarm_now(monotonic_s, wall_s, clock) for key, event in self._first.items()}

    def sequences(self) -> dict[str, int]:
        """The last sequence number of each ROI in the log at the start."""
        found: dict[str, int] = {}
        for (roi, _), event in self._first.items():
            found[roi] = max(found.get(roi, 0), event.sequence)
        return found

    @property
    def trouble(self) -> bool:
        """Whether alarms are not recorded now, or something was wrong with the log a moment ago."""
        told = self._trouble_s
        return (
            self._ill or not self._thread.is_alive() or (told is not None and self._clock() - told < TOLD_S)
        )

    def write(self, entries: Sequence[Entry]) -> bool:
        """Whether the events are on the disk now; returns within `WAIT_S`."""
        return self._hand_over(Batch(tuple(entries)))

    def add(self, notes: Sequence[Note], *, wait: bool) -> bool:
        """The same for verdicts and spans of watching; without `wait` they are written some time later."""
        return self._hand_over(Batch((), notes=tuple(notes)), wait)

    def _hand_over(self, batch: Batch, wait: bool = True) -> bool:
        with self._wake:
            if self._waiting + batch.rows > self._most_waiting:
                self._problem("lost", batch.rows)
                return False
            self._waiting += batch.rows
            self._batches.append(batch)
            self._wake.notify()
            if self._ill or not wait:
                return False
        if not batch.done.wait(WAIT_S):
            self._problem("late")
            with self._wake:
                self._ill = not batch.written  # whoever comes next need not wait, until the thread is through
        return batch.written

    def published(self, sent: Sequence[tuple[str, str]]) -> None:
        """The records of these (ROI, id) are on the bus; written some time later."""
        with self._wake:
            if len(self._batches) < 2 * self._most_waiting:  # else some are sent twice, with the same number
                self._batches.append(Batch((), tuple(sent)))
                self._wake.notify()

    def close(self) -> None:
        """Write what waits, if that does not take long."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        self._thread.join(_CLOSE_S)

    def _run(self) -> None:
        pruning = True
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._batches or self._closed, 0.0 if pruning else LOOK_S)
                if not self._batches and self._closed:
                    break
                batch = self._batches[0] if self._batches else None
            if batch is None:
                pruning = (
                    self._log is not None and self._attempt(self._keep_up) and self._removed >= PRUNE_AT_ONCE
                )
            elif not self._work_off(batch):
                break
        if self._log is not None:
            self._log.close()

    def _work_off(self, batch: Batch) -> bool:
        """Write the oldest batch, or wait a little where that cannot be; False: the end was asked for meanwhile."""
        if self._attempt(lambda: self._store_what_can_be(batch), batch):
            with self._wake:
                self._batches.popleft()
                self._waiting -= batch.rows
                self._ill = False
                batch.finish(written=not batch.refused)
            self._observer.events_written(max(len(batch.entries) - batch.refused, 0))
            self._observer.events_waiting(self._waiting)
            return True
        with self._wake:
            self._ill = True
            for waiting in self._batches:
                waiting.finish(written=False)
            if self._closed:
                return False
            self._observer.events_waiting(self._waiting)
            self._wake.wait_for(lambda: self._closed, self._retry_s)
        return True

    def _keep_up(self) -> None:
        """What is to be done while nothing waits: look where the file is, forget what is old."""
        self._find_again()
        if self._clock() - self._pruned_s >= PRUNE_EVERY_S or self._removed >= PRUNE_AT_ONCE:
            self._pruned_s, self._removed = self._clock(), 0
            self._prune()

    def _find_again(self) -> None:
        """Where somebody has removed or replaced the file under us, go on with the one that lies there."""
        if self._log is None or self._log.in_place():
            return
        # It is left open: closing would remove the journal that lies beside the file, which may be another's.
        old, self._log = self._log, None
        self._abandoned.append(old)
        with contextlib.suppress(sqlite3.Error):
            old.checkpoint()
        if self._path.exists():
            self._problem("replaced")
            log.error(
                "event log %s: was replaced by another file, which goes on with the present state", self._path
            )
        else:
            self._problem("removed")
            log.error("event log %s: was removed; it is put back with all that it held", self._path)
            try:
                old.put_back()
            except sqlite3.Error as error:
                log.error("event log %s: only the present state can be put back: %s", self._path, error)  # noqa: TRY400
        self._open_with_state()

    def _open_with_state(self) -> EventLog:
        opened = self._log = self._open_log(self._path, False)
        opened.copy(self._latest.values())
        return opened

    def _problem(self, reason: str, count: int = 1) -> None:
        self._observer.event_problem(reason, count)
        if reason in _TROUBLES:
            self._trouble_s = self._clock()

    def _attempt(self, work: Callable[[], None], batch: Batch | None = None) -> bool:
        """Do something with the file; a damaged one is replaced, and the work done on the new one.

        What nobody expected sets the batch aside, and is through with it.
        """
        for _ in range(2):
            try:
                work()
            except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
                self._drop()
                damaged = is_corrupt(error)
                self._tell("corrupt" if damaged else "unwritable", error)
                if not damaged or not self._move_aside():
                    return False
            except Exception:
                log.exception(
                    "event log %s: %s failed", self._path, batch.name if batch else "looking after it"
                )
                self._drop()
                self._problem("failed", max(batch.rows, 1) if batch else 1)
                if batch is not None:
                    batch.refused = max(batch.rows, 1)
                return batch is not None
            else:
                if self._last_problem:
                    log.info("%s: written again", self._path)
                self._last_problem = ""
                return True
        return False

    def _store_what_can_be(self, batch: Batch) -> None:
        """Write the batch; rows that no file would take are set aside, the others written."""
        try:
            self._store(batch)
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            if not is_refused(error):
                raise
            parts = batch.parts()
            if len(parts) > 1:
                for part in parts:
                    self._store_what_can_be(part)
                    batch.refused += part.refused
                return
            batch.refused = max(batch.rows, 1)
            self._problem("refused", batch.refused)
            log.error(  # noqa: TRY400 - the line says it all
                "event log %s: %s cannot be written and will not be tried again: %s",
                self._path,
                batch.name,
                ascii(str(error)),
            )

    def _start(self) -> None:
        self._log = self._open_log(self._path, True)
        self.unpublished = self._log.unpublished()
        self.records = self._log.records()
        self._latest = {(event.roi, event.alarm_class): event for event in self._log.latest()}

    def _start_reading(self) -> None:
        """Where the log cannot be written it may still say how the alarms stood."""
        try:
            self._latest = {(event.roi, event.alarm_class): event for event in read_events(self._path)}
        except EventLogError as error:
            log.warning("%s; all alarms begin as NORMAL", error)

    def _store(self, batch: Batch) -> None:
        self._find_again()
        opened = self._open()
        if batch.entries:
            opened.append(batch.entries)
            events = (entry.event for entry in batch.entries)
            self._latest |= {(event.roi, event.alarm_class): event for event in events}
        if batch.notes:
            opened.add(batch.notes)
        if batch.sent:
            opened.published(batch.sent)

    def _open(self) -> EventLog:
        """The log; a file that was not there begins with the present state."""
        if self._log is None and self._path.exists():
            self._log = self._open_log(self._path, False)
        return self._log or self._open_with_state()

    def _prune(self) -> None:
        """One step of retention, so short that no alarm waits for it."""
        if self._log is not None and self._retention is not None:
            before_s = self._wall() - self._retention.days * 86_400.0
            self._removed = self._log.prune(before_s, self._retention.events, PRUNE_AT_ONCE)
            self._observer.events_removed(self._removed)

    def _drop(self) -> None:
        if self._log is not None:
            with contextlib.suppress(sqlite3.Error):
                self._log.close()
            self._log = None

    def _move_aside(self) -> bool:
        stamp = datetime.fromtimestamp(self._wall(), UTC).strftime("%Y%m%dT%H%M%S")
        aside, number = self._path.with_name(f"{self._path.name}.corrupt-{stamp}"), 1
        while aside.exists():
            number += 1
            aside = self._path.with_name(f"{self._path.name}.corrupt-{stamp}-{number}")
        try:
            self._path.rename(aside)
            for suffix in ("-wal", "-shm"):
                journal = self._path.with_name(self._path.name + suffix)
                if journal.exists():
                    journal.rename(aside.with_name(aside.name + suffix))
        except OSError as error:
            self._tell("unwritable", error)
            return False
        log.error("%s: is damaged and was moved to %s; a new event log begins", self._path, aside.name)
        return True

    def _tell(self, reason: str, error: Exception) -> None:
        self._problem(reason)
        text = f"{self._path}: {reason}: {cause_of(error, self._path)}"
        if text != self._last_problem:  # once, not with every attempt
            log.error("event log %s; detection and the bus go on", text)
        self._last_problem = text
