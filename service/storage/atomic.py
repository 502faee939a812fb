"""Files that are either wholly there or not at all, whatever happens to the process or the power."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

_FOR_ALL = 0o644  # what one user trains, a daemon under another must read


def write_new_file(path: Path, content: bytes) -> bool:
    """Write a file that must not exist yet; False where it does.

    The content goes to a temporary file in the same folder, is flushed to the disk, and gets its
    name by a hard link, which fails where the name is taken. Raises OSError.
    """
    temporary = _temporary(path, content)
    try:
        os.link(temporary, path)
    except FileExistsError:
        return False
    finally:
        temporary.unlink()
    _flush_folder(path.parent)
    return True


def replace_file(path: Path, content: bytes, mode: int = _FOR_ALL) -> None:
    """Write a file in place of the one that may be there. Raises OSError."""
    temporary = _temporary(path, content, mode)
    try:
        temporary.replace(path)
    except OSError:
        temporary.unlink()
        raise
    _flush_folder(path.parent)


def _temporary(path: Path, content: bytes, mode: int = _FOR_ALL) -> Path:
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            os.fchmod(handle, mode)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        Path(name).unlink()
        raise
    return Path(name)


def _flush_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
