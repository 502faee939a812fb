"""Worker processes of this machine, in the shape of `concurrent.futures`.

Each has a pool of one process to itself, so one that dies (out of memory, a crash in a decoder) takes no other task
along, and it is known which task it was. Memory is bounded by the operating system.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing.connection import wait
from typing import Any

from lumpwatch.service.errors import LumpwatchError

ATTEMPTS = 2
"""A worker may have been ended by what others did; a task that loses two is the cause."""


class WorkerLostError(LumpwatchError):
    """The worker processes that did a task ended in the middle of it."""


class LocalWorkers(Executor):
    """So many processes, each with at most so many bytes of memory of its own (None: as many as there are)."""

    def __init__(self, workers: int, memory: int | None = None) -> None:
        self._memory = memory
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="batch")
        self._local = threading.local()
        self._lock = threading.Lock()
        self._slots: dict[ProcessPoolExecutor, int] = {}
        self._stopped = False

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """See `Executor`. The future raises WorkerLostError where the task's workers ended."""
        return self._threads.submit(self._do, function, arguments, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `Executor`. With `cancel_futures` tasks that are being done are ended as well."""
        if cancel_futures:
            self._stopped = True
            with self._lock:
                processes = list(self._slots.values())
            for process in processes:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGTERM)
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        with self._lock:
            slots = list(self._slots)
            self._slots.clear()
        for slot in slots:
            slot.shutdown(wait, cancel_futures=True)

    def __exit__(self, kind: object, *_: object) -> None:
        """Wait for the tasks; where an error or a person ends the work, end them."""
        self.shutdown(cancel_futures=kind is not None)

    def _do(self, function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        for _ in range(ATTEMPTS):
            if self._stopped:
                break
            try:
                return self._slot().submit(function, *arguments, **named).result()
            except BrokenExecutor:
                self._forget()
        raise WorkerLostError("its worker process ended in the middle of it (out of memory?)")

    def _slot(self) -> ProcessPoolExecutor:
        """The pool of one process of this thread."""
        slot: ProcessPoolExecutor | None = getattr(self._local, "slot", None)
        if slot is None:
            spawn = multiprocessing.get_context("spawn")
            slot = ProcessPoolExecutor(1, spawn, _begin, (self._memory,))
            process = slot.submit(os.getpid).result()
            with self._lock:
                self._slots[slot] = process
            self._local.slot = slot
        return slot

    def _forget(self) -> None:
        slot: ProcessPoolExecutor | None = getattr(self._local, "slot", None)
        self._local.slot = None
        if slot is not None:
            with self._lock:
                self._slots.pop(slot, None)
            slot.shutdown(wait=False, cancel_futures=True)


def _begin(memory: int | None) -> None:
    """What a worker process does first."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    if memory is not None:
        with contextlib.suppress(ImportError):  # no such limits beside Unix
            import resource

            hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
            limit = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
            resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def _end_with_parent() -> None:
    """A worker whose parent was killed would work on for nobody."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
