"""Runs worker processes: starts them, watches them, kills the stuck and starts the dead again."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from lumpwatch.service.telemetry import GRACE_S, STARTING, Relay, Report, Worker

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.5
LONGEST_PAUSE_S = 15.0
_CALM_S = 60.0
"""A worker that lived this long starts again without delay growing."""
_QUIET_S = 3.0
"""What a worker said longer ago is no longer shown as if it were so: silence must not look like clear."""
_STARTING_S = 120.0
"""How long a worker may take to load its libraries and, on a first start, to compile its kernels."""
_SILENT_S = 10.0
"""A worker whose reporting thread is silent for longer is stopped or swapped out: it is stuck."""


@dataclass(frozen=True, slots=True)
class Task:
    """One worker to keep running."""

    camera: str
    role: str
    target: Worker
    arguments: tuple[Any, ...]
    stuck_after_s: float
    """The main loop must beat at least this often."""

    @property
    def name(self) -> str:
        """Role and camera."""
        return f"{self.role}:{self.camera}"


class _Keeper:
    """One task and its present process."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.process: SpawnProcess | None = None
        self.connection: Connection | None = None
        self.report: Report | None = None
        self.heard_s = 0.0
        self.started_s = 0.0
        self.next_start_s = 0.0
        self.pause_s = FIRST_PAUSE_S


class Supervisor:
    """Keeps all tasks running; `watch` is called a few times a second, `stop` once."""

    def __init__(
        self,
        tasks: Sequence[Task],
        relay: Relay,
        restarted: Callable[[str, str, str], None],
    ) -> None:
        """`restarted` is told camera, role and reason of each new start."""
        self._context = multiprocessing.get_context("spawn")
        self._keepers = [_Keeper(task) for task in tasks]
        self._relay = relay
        self._restarted = restarted

    def reports(self) -> dict[tuple[str, str], Report | None]:
        """The last report of each worker by role and camera; None: not heard since its start."""
        return {(keeper.task.role, keeper.task.camera): keeper.report for keeper in self._keepers}

    def watch(self) -> None:
        """Hear all workers, kill the stuck, start the dead."""
        now = time.monotonic()
        for keeper in self._keepers:
            if keeper.process is None:
                if now >= keeper.next_start_s:
                    self._start(keeper, now)
                continue
            self._hear(keeper, now)
            if not keeper.process.is_alive():
                self._end(keeper, now, "exited")
                continue
            if keeper.report is not None and now - keeper.heard_s > _QUIET_S:
                self._relay.silent(keeper.task.name)
            if self._stuck(keeper, now):
                keeper.process.kill()
                keeper.process.join()
                self._end(keeper, now, "stuck")

    def stop(self, within_s: float = GRACE_S) -> None:
        """Ask all workers to stop, and kill those that have not by then."""
        deadline = time.monotonic() + within_s
        for keeper in self._keepers:
            if keeper.connection is not None:
                with contextlib.suppress(OSError, ValueError):
                    keeper.connection.send("stop")
        for keeper in self._keepers:
            if keeper.process is None:
                continue
            while keeper.process.is_alive() and time.monotonic() < deadline:
                self._hear(keeper, time.monotonic())  # a full pipe would keep the worker from ending
                keeper.process.join(timeout=0.02)
            if keeper.process.is_alive():
                log.warning("%s did not stop in %.0f s and was killed", keeper.task.name, within_s)
                keeper.process.kill()
                keeper.process.join()
            self._hear(keeper, time.monotonic())

    def _start(self, keeper: _Keeper, now: float) -> None:
        ours, theirs = self._context.Pipe()
        keeper.process = self._context.Process(
            target=keeper.task.target,
            args=(*keeper.task.arguments, theirs),
            name=keeper.task.name,
            daemon=True,
        )
        keeper.process.start()
        log.info("%s runs as process %d", keeper.task.name, keeper.process.pid)
        theirs.close()
        keeper.connection, keeper.report = ours, None
        keeper.started_s = keeper.heard_s = now

    def _hear(self, keeper: _Keeper, now: float) -> None:
        assert keeper.connection is not None
        try:
            while keeper.connection.poll():
                report = keeper.connection.recv()
                if isinstance(report, Report):
                    keeper.report, keeper.heard_s = report, now
                    self._relay.update(keeper.task.name, report.metrics)
        except (EOFError, OSError):
            pass  # the process is ending; is_alive tells

    def _stuck(self, keeper: _Keeper, now: float) -> bool:
        patience = keeper.task.stuck_after_s
        if keeper.report is None or keeper.report.state == STARTING:
            patience = max(_STARTING_S, patience)
        if keeper.report is None:
            return now - keeper.started_s > patience
        return now - keeper.heard_s > _SILENT_S or now - keeper.report.beat_s > patience

    def _end(self, keeper: _Keeper, now: float, reason: str) -> None:
        assert keeper.process is not None
        if now - keeper.started_s > _CALM_S:
            keeper.pause_s = FIRST_PAUSE_S
        log.error(
            "%s is %s (exit code %s); starting it again in %.1f s",
            keeper.task.name,
            "stuck and was killed" if reason == "stuck" else "gone",
            keeper.process.exitcode,
            keeper.pause_s,
        )
        keeper.process.close()
        if keeper.connection is not None:
            keeper.connection.close()
        keeper.process = keeper.connection = keeper.report = None
        keeper.next_start_s = now + keeper.pause_s
        keeper.pause_s = min(2 * keeper.pause_s, LONGEST_PAUSE_S)
        self._relay.gone(keeper.task.name)
        self._restarted(keeper.task.camera, keeper.task.role, reason)
