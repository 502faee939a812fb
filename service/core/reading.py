"""Small files and whole numbers from outside, bounded before they are believed."""

from __future__ import annotations

import errno
import os
from pathlib import Path

MOST_BYTES = 64 << 20


def read_bounded(path: Path, most: int = MOST_BYTES) -> bytes:
    """All bytes of a file, pipe or device; raises OSError, also where there are more than `most`.

    What a file says of its size is not asked: a device has none and may never end.
    """
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return content


def whole_number(text: str, most: int) -> int | None:
    """The number that ASCII digits write, None for any other text (a superscript is a digit too) and above `most`."""
    if not (text.isascii() and text.isdecimal() and len(text) <= len(str(most))):
        return None
    return number if (number := int(text)) <= most else None
