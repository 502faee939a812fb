"""Taking back what was declared."""

from __future__ import annotations

import pytest
import zenoh

from lumpwatch.service.bus import handles
from lumpwatch.service.bus.handles import undeclares


class Declared:
    """Refuses so often."""

    def __init__(self, *errors: Exception) -> None:
        self.errors = list(errors)
        self.asked = 0

    def undeclare(self) -> None:
        self.asked += 1
        if self.errors:
            raise self.errors.pop(0)


def test_what_another_thread_uses_is_taken_back_a_little_later() -> None:
    busy = Declared(*(RuntimeError("Already borrowed") for _ in range(3)))
    undeclares(busy)()
    assert busy.asked == 4


def test_what_is_used_for_ever_is_left_to_the_sessions_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handles, "_PAUSE_S", 0.0)
    busy = Declared(*(RuntimeError("Already borrowed") for _ in range(1000)))
    undeclares(busy)()
    assert 0 < busy.asked <= 100


def test_what_is_closed_already_stays_so() -> None:
    closed = Declared(zenoh.ZError("closed"))
    undeclares(closed)()
    assert closed.asked == 1
