"""The connection between the daemon and one of its worker processes.

The worker reports once a second from a thread of its own: its metrics, the time of its main loop's
last beat, and its state. The daemon tells it how often the workers before it ended of late, and asks it to stop. A
worker whose daemon is gone stops by itself.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from prometheus_client import CollectorRegistry, generate_latest

from lumpwatch.service.signals import on_end_signals

REPORT_EVERY_S = 0.5
STARTING = "starting"
"""State of a worker that has not done its work once yet."""
ORPHANED = "orphaned"
RESTARTS_WITHIN_S = 600.0
"""Restarts longer ago are forgotten."""
GRACE_S = 3.0
"""A worker that has not stopped this long after it was asked ends itself the hard way."""


@dataclass(frozen=True, slots=True)
class Restarts:
    """What the daemon tells a worker that it had to start again."""

    count: int
    """How many ends of its like led to a new start within the last `RESTARTS_WITHIN_S`."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a worker reports to the daemon."""

    beat_s: float
    """Monotonic time of the main loop's last beat."""
    metrics: str
    """Prometheus text."""
    state: str
    """One word on what the worker does."""
    decided: dict[str, float] = field(default_factory=dict)
    """Monotonic time of each ROI's last decision on a frame."""
    problem: str = ""
    """Why it cannot start, in words."""


class DaemonConnection:
    """The worker's end."""

    def __init__(self, connection: Connection, registry: CollectorRegistry) -> None:
        self._connection = connection
        self._registry = registry
        self._beat_s = time.monotonic()
        self.state = STARTING
        self.decided: dict[str, float] = {}
        self.problem = ""
        self.restarts = 0
        """How often the workers before this one ended, within `RESTARTS_WITHIN_S` before it began."""
        self.stop = threading.Event()
        """Set when the worker should end."""
        self._due = threading.Event()
        self._reporter = threading.Thread(target=self._report, name="report", daemon=True)
        self._listener = threading.Thread(target=self._listen, name="listen", daemon=True)
        self._reporter.start()
        self._listener.start()

    @property
    def orphaned(self) -> bool:
        """Whether the daemon is gone."""
        return self.state == ORPHANED

    def beat(self) -> None:
        """Called by the main loop at each turn: it is not stuck."""
        self._beat_s = time.monotonic()

    def wait(self, seconds: float) -> bool:
        """Sleep with beats; true at once when the worker should end."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.beat()
            if self.stop.wait(min(left, REPORT_EVERY_S)):
                return True
        return self.stop.is_set()

    def obey_signals(self) -> None:
        """SIGTERM and SIGINT ask this process to end in order; to be called in its main thread.

        A terminal sends them to every process, and so do managers of services: a worker that died of them at once would
        leave undone what the daemon gives it time for.
        """
        on_end_signals(self._end)

    def report_soon(self) -> None:
        """Report now, not only when it is time: somebody waits for what has changed."""
        self._due.set()

    def close(self) -> None:
        """Send the last report; called when the main loop has ended."""
        self.stop.set()
        self._due.set()
        self._reporter.join(timeout=1.0)
        self._send()

    def _report(self) -> None:
        while not self.stop.is_set():
            self._send()
            self._due.wait(REPORT_EVERY_S)
            self._due.clear()

    def _send(self) -> None:
        text = generate_latest(self._registry).decode()
        try:
            self._connection.send(Report(self._beat_s, text, self.state, dict(self.decided), self.problem))
        except OSError:
            self.stop.set()

    def _listen(self) -> None:
        try:
            while isinstance(message := self._connection.recv(), Restarts):
                self.restarts = message.count
        except (EOFError, OSError):
            self.state = ORPHANED
        self._end()

    def _end(self) -> None:
        """Ask the main loop to end, and end the process where it does not in time."""
        self.stop.set()
        time.sleep(GRACE_S)
        os._exit(1)


Worker = Callable[..., None]
"""What runs in a worker process: a function of picklable arguments and, last, the connection."""


def work(target: Worker, *arguments: Any) -> None:
    """Runs in the process: ends it as soon as the work is done.

    Taking the interpreter and its libraries apart takes seconds on a busy machine, and the time to stop is limited.
    Not with the supervisor: a process loads what it starts with, and only a monitor needs the filter.
    """
    target(*arguments)
    logging.shutdown()
    sys.stdout.flush()
    os._exit(0)
