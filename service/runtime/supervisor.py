"""Runs worker processes: starts them, watches them, kills the stuck and starts the dead again.

Nothing here waits without a limit. A process that is stuck in a driver does not even die when it is killed; it
runs no code of ours any more either, so its task is started anew beside it, and it is forgotten when it is gone.
"""

from __future__ import annotations

import logging
import multiprocessing
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any, Protocol

from lumpwatch.service.runtime.ends import how_ended
from lumpwatch.service.runtime.report_reader import ReportReader
from lumpwatch.service.telemetry import (
    GRACE_S,
    RESTARTS_WITHIN_S,
    STARTING,
    Relay,
    Report,
    Restarts,
    Worker,
    work,
)

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.5
LONGEST_PAUSE_S = 15.0
MOST_UNDEAD = 2
"""Processes of a task that were killed and are still there; with as many no other one is started."""
KILLED_S = 1.0
"""How long to wait at the end for processes that were killed."""
_LAST_WORDS_S = 0.5
"""How long to wait for the last report of a worker that has ended: it is in the pipe already."""
_CALM_S = 60.0
"""A worker that lived this long starts again without delay growing."""
_QUIET_S = 3.0
"""What a worker reported longer ago is no longer shown as if it were so: silence must not look like clear."""
_STARTING_S = 120.0
"""How long a worker may take to load its libraries and, on a first start, to compile its kernels."""
_LATE_S = 1.0
"""After a pause of the daemon itself that was longer, workers get as long to report before they are judged."""
_SILENT_S = 10.0
"""A worker whose reporting thread is silent for longer is stopped or swapped out: it is stuck."""


@dataclass(frozen=True, slots=True)
class Task:
    """One worker to keep running."""

    camera: str
    """Empty: of all cameras."""
    role: str
    target: Worker
    arguments: tuple[Any, ...]
    stuck_after_s: float
    """The main loop must beat at least this often."""

    @property
    def name(self) -> str:
        """Role and camera; the role alone where it serves all cameras."""
        return f"{self.role}:{self.camera}" if self.camera else self.role


class Process(Protocol):
    """What the supervisor needs of a process, as `multiprocessing` has it."""

    @property
    def pid(self) -> int | None:
        """Its number."""

    @property
    def exitcode(self) -> int | None:
        """None while it runs."""

    def is_alive(self) -> bool:
        """Whether it runs; does not wait."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended, or so many seconds."""

    def kill(self) -> None:
        """Send SIGKILL."""

    def close(self) -> None:
        """Let go of one that has ended."""


Start = Callable[[Task], tuple[Process, Connection]]
"""Starts a process that works on a task; gives it and the daemon's end of its line."""


def spawn(task: Task) -> tuple[Process, Connection]:
    """A new process that works on the task, and the daemon's end of its line."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    arguments = (task.target, *task.arguments, theirs)
    process = context.Process(target=work, args=arguments, name=task.name, daemon=True)
    process.start()
    theirs.close()
    return process, ours


@dataclass(slots=True)
class _Running:
    """The present process of a task."""

    process: Process
    reader: ReportReader
    started_s: float
    heard_s: float
    report: Report | None = None
    asked_to_end: bool = False
    """Another task takes its place: its end is none of its own."""


@dataclass(slots=True)
class _Keeper:
    """One task, its present process, and those before it that do not die."""

    task: Task
    running: _Running | None = None
    undead: list[Process] = field(default_factory=list)
    next_start_s: float = 0.0
    pause_s: float = FIRST_PAUSE_S
    ends_s: deque[float] = field(default_factory=deque)
    """When its processes of late ended by themselves."""

    def restarts(self, now: float) -> int:
        """How many of them within `RESTARTS_WITHIN_S`."""
        while self.ends_s and now - self.ends_s[0] > RESTARTS_WITHIN_S:
            self.ends_s.popleft()
        return len(self.ends_s)


class Supervisor:
    """Keeps all tasks running; `watch` is called a few times a second, `stop` once."""

    def __init__(
        self,
        tasks: Sequence[Task],
        relay: Relay,
        restarted: Callable[[str, str, str], None],
        *,
        start: Start = spawn,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`restarted` is called with camera, role and reason of each end that leads to a new start."""
        self._keepers = [_Keeper(task) for task in tasks]
        self._relay = relay
        self._restarted = restarted
        self._spawn = start
        self._clock = clock
        self._watched_s = self._judged_from_s = clock()

    def reports(self) -> dict[tuple[str, str], Report | None]:
        """The last report of each worker by role and camera; None: no report since its start."""
        return {
            (keeper.task.role, keeper.task.camera): keeper.running.report if keeper.running else None
            for keeper in self._keepers
        }

    def watch(self) -> None:
        """Hear all workers, kill the stuck, start the dead. Never waits for a worker that lives."""
        now = self._clock()
        if now - self._watched_s > _LATE_S:
            self._judged_from_s = now + _LATE_S
        self._watched_s = now
        for keeper in self._keepers:
            keeper.undead = [process for process in keeper.undead if not _gone(process)]
            running = keeper.running
            if running is None:
                if now >= keeper.next_start_s and len(keeper.undead) < MOST_UNDEAD:
                    self._start(keeper, now)
                continue
            alive = running.process.is_alive()
            if not alive:
                running.reader.wait_for_end(_LAST_WORDS_S)
            self._hear(keeper.task, running)
            if not alive:
                self._end(keeper, running, now, "exited")
                continue
            if running.report is not None and now - running.heard_s > _QUIET_S:
                self._relay.silent(keeper.task.name)
            if now >= self._judged_from_s and self._stuck(keeper.task, running, now):
                running.process.kill()
                self._end(keeper, running, now, "stuck")

    def replace(self, task: Task) -> None:
        """Another task in place of that of the same name: its worker is asked to end, and starts with the new one."""
        for keeper in self._keepers:
            if keeper.task.name == task.name:
                keeper.task = task
                if keeper.running is not None:
                    keeper.running.asked_to_end = True
                    keeper.running.reader.ask_to_stop()

    def stop(self, within_s: float = GRACE_S) -> tuple[str, ...]:
        """Ask all workers to stop, and kill those that have not by then.

        Takes little longer than `within_s`. Gives the tasks of which a process is left that cannot be killed.
        """
        running = [(keeper, keeper.running) for keeper in self._keepers if keeper.running is not None]
        deadline = self._clock() + within_s
        for _, worker in running:
            worker.reader.ask_to_stop()
        for keeper, worker in running:
            worker.process.join(timeout=max(0.0, deadline - self._clock()))
            if worker.process.is_alive():
                log.warning("%s did not stop in %.0f s and was killed", keeper.task.name, within_s)
                worker.process.kill()
        deadline = self._clock() + KILLED_S
        for keeper, worker in running:
            worker.process.join(timeout=max(0.0, deadline - self._clock()))
            worker.reader.wait_for_end(max(0.0, deadline - self._clock()))
            self._hear(keeper.task, worker)
        left = tuple(
            keeper.task.name
            for keeper in self._keepers
            if any(p.is_alive() for p in keeper.undead)
            or (keeper.running is not None and keeper.running.process.is_alive())
        )
        for name in left:
            log.error("%s: a process that was killed is still there: the system holds it in a driver", name)
        return left

    def _start(self, keeper: _Keeper, now: float) -> None:
        try:
            process, connection = self._spawn(keeper.task)
        except OSError as error:  # no descriptor, process or memory to be had now
            text = "%s cannot be started: %s; trying again in %.1f s"
            log.error(text, keeper.task.name, error, keeper.pause_s)  # noqa: TRY400 - the line says it all
            keeper.next_start_s = now + keeper.pause_s
            keeper.pause_s = min(2 * keeper.pause_s, LONGEST_PAUSE_S)
            return
        log.info("%s runs as process %d", keeper.task.name, process.pid)
        reader = ReportReader(connection, keeper.task.name, self._clock)
        if restarts := keeper.restarts(now):
            reader.tell(Restarts(restarts))
        keeper.running = _Running(process, reader, now, now)

    def _hear(self, task: Task, running: _Running) -> None:
        if (newest := running.reader.take()) is not None:
            running.report, running.heard_s = newest
            self._relay.update(task.name, running.report.metrics)

    def _stuck(self, task: Task, running: _Running, now: float) -> bool:
        patience, report = task.stuck_after_s, running.report
        if report is None or report.state == STARTING:
            patience = max(_STARTING_S, patience)
        if report is None:
            return now - running.started_s > patience
        return now - running.heard_s > _SILENT_S or now - report.beat_s > patience

    def _end(self, keeper: _Keeper, running: _Running, now: float, reason: str) -> None:
        if now - running.started_s > _CALM_S:
            keeper.pause_s = FIRST_PAUSE_S
        log.error(
            "%s is %s; starting it again in %.1f s",
            keeper.task.name,
            "stuck and was killed" if reason == "stuck" else f"gone ({how_ended(running.process.exitcode)})",
            keeper.pause_s,
        )
        keeper.running = None
        if not running.asked_to_end:
            keeper.ends_s.append(now)
        if not _gone(running.process):
            keeper.undead.append(running.process)
        if len(keeper.undead) >= MOST_UNDEAD:
            log.error(
                "%s: %d killed processes do not go away; no other is started", keeper.task.name, MOST_UNDEAD
            )
        keeper.next_start_s = now + keeper.pause_s
        keeper.pause_s = min(2 * keeper.pause_s, LONGEST_PAUSE_S)
        self._relay.gone(keeper.task.name)
        self._restarted(keeper.task.camera, keeper.task.role, reason)


def _gone(process: Process) -> bool:
    """Whether a process has ended; lets go of it then."""
    if process.is_alive():
        return False
    process.close()
    return True
