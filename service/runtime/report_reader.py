"""Hears one worker from a thread of its own, so that a worker that breaks off in a message holds up nobody."""

from __future__ import annotations

import contextlib
import logging
import pickle
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

from lumpwatch.service.telemetry import Report, Restarts

log = logging.getLogger(__name__)

MOST_BYTES = 16 << 20
"""A longer message ends the line: the metrics of a camera with 64 regions are some 500 kB."""


class ReportReader:
    """The daemon's end of a worker's line. The thread ends when the worker's end is closed."""

    def __init__(
        self, connection: Connection, name: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._connection = connection
        self._name = name
        self._clock = clock
        self._lock = threading.Lock()
        self._newest: tuple[Report, float] | None = None
        self._asked_to_stop = False
        self._thread = threading.Thread(target=self._read, name=f"hear {name}", daemon=True)
        self._thread.start()

    def take(self) -> tuple[Report, float] | None:
        """The newest report since the last call, with the monotonic time at which it came."""
        with self._lock:
            newest, self._newest = self._newest, None
        return newest

    def tell(self, restarts: Restarts) -> None:
        """Tell the worker how often those before it ended; nothing where its line is closed."""
        with self._lock, contextlib.suppress(OSError, ValueError):
            self._connection.send(restarts)

    def ask_to_stop(self) -> None:
        """Tell the worker to end; nothing where its line is closed."""
        with self._lock, contextlib.suppress(OSError, ValueError):
            self._asked_to_stop = True
            self._connection.send("stop")

    def wait_for_end(self, within_s: float) -> None:
        """Wait until all reports of an ended worker are read, but no longer than this."""
        self._thread.join(timeout=within_s)

    def _read(self) -> None:
        try:
            while True:
                self._keep(self._connection.recv_bytes(MOST_BYTES))
        except EOFError:
            pass
        except OSError as error:
            # A worker that ended by itself (Ctrl-C reaches it as well) left "stop" unread, which resets the line.
            level = logging.DEBUG if self._asked_to_stop else logging.WARNING
            log.log(level, "%s: its line broke (%s)", self._name, error)
        with self._lock:
            self._connection.close()

    def _keep(self, message: bytes) -> None:
        try:
            report = pickle.loads(message)
        except Exception as error:
            log.warning("%s: sent what cannot be read (%s)", self._name, error)
            return
        if isinstance(report, Report):
            with self._lock:
                self._newest = report, self._clock()
