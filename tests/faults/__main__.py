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

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        load = os.getloadavg()[1]
        measured = f"All in one run on {os.cpu_count()} cores, whose load was {load:.1f} when it began."
        code = pytest.main([str(HERE), "--fault-table", folder, *sys.argv[1:]])
        if code == pytest.ExitCode.OK:
            rows = table.read(Path(folder))
            PAGE.write_text(table.page(rows, version("lumpwatch"), measured), encoding="utf-8")
    sys.exit(code)
