"""Others under this camera's names are told, once, and for as long as they are there."""

from __future__ import annotations

import pytest

from lumpwatch.service.core import Trouble
from lumpwatch.service.monitor.rivals import STANDS_S, Rivals


def test_rivals_are_told_while_they_are_there(caplog: pytest.LogCaptureFixture) -> None:
    now_s = 50.0
    rivals = Rivals("cam", lambda: now_s)
    nobody = {Trouble.SECOND_SOURCE: False, Trouble.SECOND_MONITOR: False}
    rivals.frames(0)
    assert rivals.troubles() == nobody
    rivals.frames(3)
    rivals.monitor("b" * 16)
    assert all(rivals.troubles().values())
    now_s += STANDS_S / 2
    rivals.frames(4)
    now_s += STANDS_S / 2
    rivals.frames(4)
    assert rivals.troubles() == nobody | {Trouble.SECOND_SOURCE: True}
    now_s += STANDS_S
    assert rivals.troubles() == nobody
    assert len(caplog.records) == 2
