"""Does all faults and writes docs/results/faults.md: `python -m tests.faults`."""

from __future__ import annotations

import os
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.faults import table

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "results" / "faults.md"


class LeftOut:
    """What could not be done on this machine, and why: the page must not be silent about it."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped and isinstance(report.longrepr, tuple):
            why = str(report.longrepr[2]).removeprefix("Skipped: ")
            self.told.append(f"`{report.nodeid.rpartition('::')[2]}` ({why})")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        load = os.getloadavg()[1]
        measured = f"All in one run on {os.cpu_count()} cores, whose load was {load:.1f} when it began."
        left_out = LeftOut()
        code = pytest.main([str(HERE), "--fault-table", folder, *sys.argv[1:]], plugins=[left_out])
        if code == pytest.ExitCode.OK:
            if left_out.told:
                measured += f" Left out there: {'; '.join(left_out.told)}."
            rows = table.read(Path(folder))
            PAGE.write_text(table.page(rows, version("lumpwatch"), measured), encoding="utf-8")
    sys.exit(code)
