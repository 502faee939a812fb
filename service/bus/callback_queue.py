"""A daemon thread that runs jobs in order, so that user code never runs in zenoh's own threads.

A publisher's jobs are its messages, so that whoever decides never waits for who reads.

zenoh's callback threads are not daemons and keep the interpreter from exiting while a session is open;
callbacks run directly by its network threads stall the whole session. So its callbacks only submit.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable

_log = logging.getLogger(__name__)

Job = Callable[[], None]


class Worker:
    """Runs jobs one after another; when more than `limit` wait, the oldest is dropped and counted."""

    def __init__(self, name: str, limit: int = 4096) -> None:
        self.dropped = 0
        self._name = name
        self._jobs: deque[Job] = deque(maxlen=limit)
        self._wake = threading.Condition()
        self._busy = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=f"bus {name}", daemon=True)
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Queue a job; ignored once closed."""
        with self._wake:
            if self._closed:
                return
            full = len(self._jobs) == self._jobs.maxlen
            self.dropped += full
            self._jobs.append(job)
            self._wake.notify_all()
        if full and self.dropped == 1:
            _log.error("%s: cannot keep up, messages are dropped", self._name)

    def offer(self, job: Job) -> bool:
        """Queue a job only where none waits or runs; whether that was so. True once closed, as for `submit`."""
        with self._wake:
            if self._closed:
                return True
            if self._busy or self._jobs:
                return False
            self._jobs.append(job)
            self._wake.notify_all()
        return True

    @property
    def idle(self) -> bool:
        """Whether no job waits or runs."""
        with self._wake:
            return not (self._busy or self._jobs)

    def drain(self, within_s: float) -> bool:
        """Wait until no job waits or runs, but no longer than this; whether that was so."""
        with self._wake:
            return self._wake.wait_for(lambda: self._closed or not (self._busy or self._jobs), within_s)

    def close(self) -> None:
        """Forget waiting jobs and end after the running one; does not wait for it."""
        with self._wake:
            self._closed = True
            self._jobs.clear()
            self._wake.notify_all()

    def guard(self, job: Job) -> None:
        """Run a job now; what it raises is logged."""
        try:
            job()
        except Exception:
            _log.exception("%s: the callback failed", self._name)

    def _run(self) -> None:
        while True:
            with self._wake:
                self._busy = False
                self._wake.notify_all()
                self._wake.wait_for(lambda: self._jobs or self._closed)
                if self._closed:
                    return
                job = self._jobs.popleft()
                self._busy = True
            self.guard(job)
