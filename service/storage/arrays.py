"""Arrays of a NumPy archive from somebody else: bounded before anything is unpacked, and numbers only."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]

_MOST_MEMBERS = 1000


class OutdatedError(ValueError):
    """Content of an older version; the text says what to do."""


def load_arrays(content: bytes, most_bytes: int) -> Arrays:
    """The arrays by name. Raises ValueError where they are more than `most_bytes` together, or no numbers.

    A small archive can claim to hold gigabytes, and its checksum is right all the same.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as members:
        listed = members.infolist()
    if len(listed) > _MOST_MEMBERS or sum(member.file_size for member in listed) > most_bytes:
        raise ValueError("holds more than there can be")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive.files}
    for key, array in arrays.items():
        if array.dtype.kind not in "fiub" or array.nbytes > most_bytes:
            raise ValueError(f"{key} is no array of numbers")
    return arrays


def within(name: str, values: Any, low: float, high: float) -> None:
    """Raises ValueError where a value is not finite or outside [low, high]."""
    array = np.asarray(values, dtype=np.float64)
    if not (np.isfinite(array).all() and (array >= low).all() and (array <= high).all()):
        raise ValueError(f"{name} is outside {low:g} to {high:g}")
