"""What tasks do in these tests: functions of a module, so that other processes find them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from lumpwatch.service.errors import LumpwatchError


def double(number: int) -> int:
    """Twice as much; an expected error for 13, an unexpected one for 0."""
    if number == 13:
        raise LumpwatchError("thirteen.mp4: damaged")
    return 2 * number * (number // number)


def die(number: int) -> int:
    """Twice as much; 13 kills the process that tries."""
    if number == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return double(number)


def die_once(marker: str) -> str:
    """The process that does it first is killed."""
    if marker and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return marker


def fill(megabytes: int) -> int:
    """Take so much memory."""
    return int(np.ones(megabytes << 17).sum()) >> 17


def sleep(marker: str) -> str:
    """Say that it began, and go on for an hour."""
    Path(marker).write_text(str(os.getpid()))
    time.sleep(3600)
    return marker
