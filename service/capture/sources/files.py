"""Why a file or folder cannot be used, in one line that names it."""

from __future__ import annotations

import stat
from pathlib import Path

from lumpwatch.service.capture.sources.base import Fault, SourceError


def os_error(name: str, error: OSError) -> SourceError:
    """A SourceError for what the operating system says about a file."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return SourceError(Fault.NOT_FOUND, f"{name}: no such file or folder")
        case PermissionError():
            return SourceError(Fault.NO_PERMISSION, f"{name}: no permission to read it")
        case _:
            return SourceError(Fault.UNREACHABLE, f"{name}: cannot be read ({error.strerror})")


def check_regular(path: Path, name: str) -> None:
    """Raises SourceError for a pipe or device: opening one may wait for ever, and reading it never end. And OSError."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise SourceError(Fault.CODEC, f"{name}: is a pipe, socket or device, expected a file")


def check_file(path: Path, name: str) -> int:
    """The size in bytes of a file that can be opened; raises SourceError."""
    try:
        if path.is_dir():
            raise SourceError(Fault.CODEC, f"{name}: is a folder, expected a video file")
        check_regular(path, name)
        with path.open("rb") as file:
            size = file.seek(0, 2)
    except OSError as error:
        raise os_error(name, error) from error
    if size == 0:
        raise SourceError(Fault.EMPTY, f"{name}: the file is empty")
    return size
