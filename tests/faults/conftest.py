from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.table import Record, Row, write


@pytest.fixture(scope="session")
def record(pytestconfig: pytest.Config) -> Record:
    """Checks a row and, with --fault-table, keeps it."""
    folder: Path | None = pytestconfig.getoption("--fault-table")

    def take(row: Row) -> None:
        print(row)
        row.check()
        if folder is not None:
            write(row, folder)

    return take
