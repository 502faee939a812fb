from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Commands under test set it too, and numba does not forgive a change once its threads run.
os.environ["NUMBA_NUM_THREADS"] = "1"

# Examples are not timed: a machine that is busy, or a kernel that compiles, is no failure.
settings.register_profile("lumpwatch", deadline=None)
settings.load_profile("lumpwatch")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--fault-table",
        type=Path,
        metavar="DIR",
        help="write what each test of tests/faults measured to this folder (`python -m tests.faults` uses it)",
    )
