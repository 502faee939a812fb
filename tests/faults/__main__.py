"""Does all faults and writes docs/results/faults.md: `python -m tests.faults`."""

from __future__ import annotations

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
        code = pytest.main([str(HERE), "--fault-table", folder, *sys.argv[1:]])
        if code == pytest.ExitCode.OK:
            PAGE.write_text(table.page(table.read(Path(folder)), version("lumpwatch")), encoding="utf-8")
    sys.exit(code)
