"""What every declared zenoh object shares: how it is taken back, and how its errors read."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from time import sleep
from typing import Protocol, TypeVar

import zenoh
from zenoh.handlers import Callback

from lumpwatch.service.bus.callback_queue import Worker

_T = TypeVar("_T")

_OS_ERROR = re.compile(r"([^:\[\]]+) \(os error \d+\)")


class Declared(Protocol):
    """Anything that zenoh declares."""

    def undeclare(self) -> None:
        """Take it back."""


class Closeable(Protocol):
    """Anything that zenoh opens."""

    def close(self) -> None:
        """Close it."""


class Handle:
    """Something on the bus that lives until it, or the bus, is closed."""

    def __init__(self) -> None:
        self._closers: tuple[Callable[[], None], ...] = ()

    def on_close(self, *closers: Callable[[], None]) -> None:
        """Run these, in order, when closed (for the bus only)."""
        self._closers += closers

    def close(self) -> None:
        """Take it back; idempotent."""
        closers, self._closers = self._closers, ()
        for closer in closers:
            closer()


_TRIES, _PAUSE_S = 100, 0.01


def undeclares(declared: Declared) -> Callable[[], None]:
    """A closer that takes it back; nothing happens where it, or its session, is already closed.

    While another thread puts by it (which may be waiting for a reader), zenoh refuses with RuntimeError. It is tried
    again for a second; then the end of the session takes it back.
    """

    def close() -> None:
        for _ in range(_TRIES):
            try:
                return declared.undeclare()
            except zenoh.ZError:
                return None
            except RuntimeError:
                sleep(_PAUSE_S)
        return None

    return close


def shut(session: Closeable) -> None:
    """Close a session (typed: the stubs leave it open)."""
    session.close()


def direct(callback: Callable[[_T], object]) -> Callback[_T]:
    """A callback that zenoh's network threads run themselves: it must be as short as a swap or an append."""
    return Callback(callback, indirect=False)


def queue(worker: Worker, job: Callable[[_T], None]) -> Callable[[_T], None]:
    """A callback that leaves the job to a worker."""
    return lambda item: worker.submit(partial(job, item))


def reason(error: zenoh.ZError) -> str:
    """The error in a few words, without zenoh's source positions."""
    text = str(error)
    if found := _OS_ERROR.search(text):
        return found.group(1).strip()
    return " ".join(text.split(" at /")[0].split()).rstrip(" .!")
