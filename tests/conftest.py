from __future__ import annotations

import logging
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from lumpwatch.service.threads import use_one_thread

# As commands and daemons do: BLAS reads it when it is loaded, and numba does not forgive a change once its threads run.
# Whatever loads NumPy is imported later, within functions: with threads a product of small matrices takes 300 times as
# long on a busy machine.
if "numpy" in sys.modules and "OPENBLAS_NUM_THREADS" not in os.environ:
    raise RuntimeError("NumPy was loaded before it could be told to use one thread")
use_one_thread()

# Examples are not timed: a machine that is busy, or a kernel that compiles, is no failure.
settings.register_profile("lumpwatch", deadline=None)
settings.load_profile("lumpwatch")


@pytest.fixture(autouse=True)
def log_of_its_own() -> Iterator[None]:
    """A command that a test ran in this process logs to that test's standard error, which later ones do not have."""
    yield
    from lumpwatch.service.core.logs import OneLine

    root = logging.getLogger()
    for handler in [one for one in root.handlers if isinstance(one.formatter, OneLine)]:
        root.removeHandler(handler)
        root.setLevel(logging.WARNING)
        logging.getLogger("lumpwatch").setLevel(logging.NOTSET)


LONG = (
    "training/test_training.py",
    "training/test_training_report.py",
    "console/test_console_demo.py",
    "console/test_console_newcomer.py",
    "console/test_console_labels_browser.py",
    "console/test_console_browser.py",
    "training/test_refining.py",
    "test_difficulty.py",
    "detection/test_never_clear_when_blind.py",
    "test_experiments.py",
    "test_gallery.py",
    "faults/test_records.py",
    "faults/test_networks.py",
    "faults/test_gateway.py",
    "faults/test_a_day.py",
    "faults/test_long_run.py",
)
"""Files that take longest, whatever the number of their tests."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Workers that share files begin with those that take long, so that none is still at one when all else is done."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    here = Path(__file__).parent
    rank = {here / name: number for number, name in enumerate(LONG)}
    tests = Counter(item.path for item in items)
    items.sort(key=lambda item: (rank.get(item.path, len(LONG)), -tests[item.path]))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--fault-table",
        type=Path,
        metavar="DIR",
        help="write what each test of tests/faults measured to this folder (`python -m tests.faults` uses it)",
    )
