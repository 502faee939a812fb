"""How a picture must be turned to be seen as any player shows it, and what else must be done to its rows.

Recordings of MP4 and MOV, and photographs (EXIF), may say that they lie on their side or upside down.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, cast

import numpy as np
from av import VideoFrame
from numpy.typing import NDArray

if TYPE_CHECKING:
    from typing_extensions import Buffer

Matrix = tuple[int, int, int, int]
"""a, b, c, d of x' = a x + c y, y' = b x + d y; each is -1, 0 or 1."""

UPRIGHT: Matrix = (1, 0, 0, 1)
_BY_EXIF: dict[int, Matrix] = {
    1: UPRIGHT,
    2: (-1, 0, 0, 1),
    3: (-1, 0, 0, -1),
    4: (1, 0, 0, -1),
    5: (0, 1, 1, 0),
    6: (0, 1, -1, 0),
    7: (0, -1, -1, 0),
    8: (0, -1, 1, 0),
}
_BY_ANGLE: dict[int, Matrix] = {
    0: UPRIGHT,
    -90: (0, 1, -1, 0),
    180: (-1, 0, 0, -1),
    -180: (-1, 0, 0, -1),
    90: (0, -1, 1, 0),
}
_ORIENTATION = 0x0112


def matrix_of(picture: VideoFrame) -> Matrix:
    """What the picture's display matrix asks for. Raises ValueError for what is no quarter turn or mirror."""
    angle = picture.rotation
    try:
        side = picture.side_data.get("DISPLAYMATRIX")
    except ValueError:  # side data of a kind that PyAV does not know, such as EXIF
        side = None
    if side is None:
        if angle not in _BY_ANGLE:
            raise ValueError(f"it asks to be turned by {angle} degrees; only quarter turns can be")
        return _BY_ANGLE[angle]
    a, b, _, c, d = struct.unpack("<5i", memoryview(cast("Buffer", side))[:20])
    signs = (_sign(a), _sign(b), _sign(c), _sign(d))
    sizes = sorted({abs(value) for value in (a, b, c, d)} - {0})
    if signs not in _BY_EXIF.values() or len(sizes) != 1:
        raise ValueError("it asks for more than a quarter turn or a mirror; make it upright first")
    return signs


def exif_matrix(content: bytes) -> Matrix | None:
    """What the EXIF of a JPEG file asks for; None where it says nothing."""
    start = content.find(b"Exif\0\0", 0, 1 << 16)
    if not content.startswith(b"\xff\xd8") or start < 0:
        return None
    tiff = content[start + 6 :]
    order = {b"MM": ">", b"II": "<"}.get(tiff[:2])
    try:
        if order is None:
            return None
        (at,) = struct.unpack_from(order + "I", tiff, 4)
        (count,) = struct.unpack_from(order + "H", tiff, at)
        for k in range(min(count, 256)):
            tag, _, _, value = struct.unpack_from(order + "HHIH", tiff, at + 2 + 12 * k)
            if tag == _ORIENTATION:
                return _BY_EXIF.get(value)
    except struct.error:
        pass  # cut off: no orientation
    return None


def turned(plane: NDArray[np.uint8], matrix: Matrix) -> NDArray[np.uint8]:
    """The plane (h, w) as it is to be seen: (h, w), or (w, h) after a quarter turn."""
    a, b, c, d = matrix
    rows, columns = (d, a) if a else (b, c)
    seen = (plane if a else plane.T)[:: 1 if rows > 0 else -1, :: 1 if columns > 0 else -1]
    return np.ascontiguousarray(seen)


def turned_i420(packed: NDArray[np.uint8], matrix: Matrix) -> NDArray[np.uint8]:
    """The same of packed planes (h * 3 / 2, w)."""
    height, width = packed.shape[0] * 2 // 3, packed.shape[1]
    chroma = packed[height:].reshape(2, height // 2, width // 2)
    luma = turned(packed[:height], matrix)
    parts = [luma.reshape(-1), *(turned(plane, matrix).reshape(-1) for plane in chroma)]
    return np.concatenate(parts).reshape(-1, luma.shape[1])


def one_field(luma: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The upper field of an interlaced picture (h, w), its rows between filled with their neighbours' mean.

    The two fields are taken at different times, so what moves has a comb.
    """
    seen = luma.copy()
    below = luma[2::2]
    seen[1 : 2 * len(below) : 2] = (luma[: 2 * len(below) : 2].astype(np.uint16) + below + 1) >> 1
    if luma.shape[0] % 2 == 0:
        seen[-1] = luma[-2]
    return seen


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)
