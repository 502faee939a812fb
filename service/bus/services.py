"""Several services behind one queryable: which of them a query means, and which of them wait for each other."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import zenoh

from lumpwatch.service.bus.callback_queue import Worker
from lumpwatch.service.bus.endpoints import Handler, answer, leave, refuse


@dataclass(frozen=True, slots=True)
class Service:
    """One of several keys that are served together."""

    handler: Handler
    lane: str
    """Queries of a lane are answered one after another, in a thread of the bus for it; lanes run side by side."""
    waits: bool = True
    """Whether a query waits for its turn; else it is refused while its lane is busy."""


class Lanes:
    """The threads of a session in which services are answered: one a lane."""

    def __init__(self, refusals: Worker) -> None:
        """`refusals` is the thread that answers queries that are refused."""
        self._refusals = refusals
        self._workers: dict[str, Worker] = {}
        self._lock = threading.Lock()

    def dispatcher(self, prefix: str, services: Mapping[str, Service]) -> Callable[[zenoh.Query], None]:
        """Hands each query of `prefix`/NAME to the lane of its service; runs in zenoh's threads, so it only submits."""
        workers = {name: self._worker(service.lane) for name, service in services.items()}

        def dispatch(query: zenoh.Query) -> None:
            name = str(query.key_expr).rpartition("/")[2]
            if name not in services:
                leave(query)
                return
            service = services[name]
            job = partial(answer, f"{prefix}/{name}", service.handler, query)
            if service.waits:
                workers[name].submit(job)
            elif not workers[name].offer(job):
                self._refusals.submit(partial(refuse, f"another {name} is under way: ask again later", query))

        return dispatch

    def close(self) -> None:
        """Forget what waits."""
        with self._lock:
            for worker in self._workers.values():
                worker.close()

    def _worker(self, lane: str) -> Worker:
        with self._lock:
            if lane not in self._workers:
                self._workers[lane] = Worker(lane)
            return self._workers[lane]
