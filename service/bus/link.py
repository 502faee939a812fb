"""What every declared zenoh object shares: how it is taken back, and how its errors read."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from typing import Protocol

import zenoh

_OS_ERROR = re.compile(r"([^:\[\]]+) \(os error \d+\)")


class Declared(Protocol):
    """Anything that zenoh declares."""

    def undeclare(self) -> None:
        """Take it back."""


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


def undeclares(declared: Declared) -> Callable[[], None]:
    """A closer that takes it back; nothing happens where it, or its session, is already closed."""

    def close() -> None:
        with contextlib.suppress(zenoh.ZError):
            declared.undeclare()

    return close


def reason(error: zenoh.ZError) -> str:
    """The error in a few words, without zenoh's source positions."""
    text = str(error)
    if found := _OS_ERROR.search(text):
        return found.group(1).strip()
    return " ".join(text.split(" at /")[0].split()).rstrip(" .!")
