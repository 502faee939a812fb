"""Why SQLite cannot open a file: it says the same of a folder that is missing and of descriptors that have run out."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

_FILES = 3
"""The database, its journal and the journal's index."""


def cause_of(error: Exception, path: Path) -> Exception:
    """What the system says where SQLite could not open `path`, read-only at least; else the error itself."""
    code = getattr(error, "sqlite_errorcode", None)
    if code is None or code & 0xFF != sqlite3.SQLITE_CANTOPEN:
        return error
    try:
        with contextlib.ExitStack() as stack:
            for _ in range(_FILES):
                stack.enter_context(path.open("rb"))
    except OSError as system:
        return error if isinstance(system, FileNotFoundError) else OSError(system.strerror)
    return error
