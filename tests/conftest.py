from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

from lumpwatch.service.threads import use_one_thread

# As commands and daemons do: BLAS reads it when it is loaded, and numba does not forgive a change once its threads run.
use_one_thread()

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
