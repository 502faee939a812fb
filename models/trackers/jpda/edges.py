"""Boxes that the edge of the picture cuts.

Of an object that comes or goes only a part is seen: the middle of that part moves at half the object's
speed, and its size is not the object's. The side inside the picture is right, so the
centre is measured from there, by the size that the target is known to have.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_NEAR = 1.0
"""How near to the edge, in pixels, a box counts as cut."""


def cut_by_edge(boxes: Array, shape: tuple[int, int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which boxes (m, 4) are cut at the low and at the high end of each axis, (m, 2) each; never at both."""
    limit = np.array([shape[1], shape[0]], dtype=float)
    low = boxes[:, :2] - 0.5 * boxes[:, 2:] <= _NEAR
    high = boxes[:, :2] + 0.5 * boxes[:, 2:] >= limit - _NEAR
    return low & ~high, high & ~low


def centres(boxes: Array, sizes: Array, shape: tuple[int, int]) -> Array:
    """Centre of each box (m, 4) if it is that of a target of each of the sizes (n, 2): (n, m, 2)."""
    low, high = cut_by_edge(boxes, shape)
    hidden = 0.5 * np.maximum(sizes[:, None, :] - boxes[None, :, 2:], 0.0)
    return boxes[:, :2] + np.where(high, hidden, 0.0) - np.where(low, hidden, 0.0)
