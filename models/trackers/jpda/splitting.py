"""A foreground region that holds several targets, cut into one box for each.

Objects that touch are one region of the foreground mask. Which targets it holds, where in it and how
large they are is known from their predicted boxes. The arrangement is kept: the box around the
predicted boxes is mapped to the region's box, axis by axis, and each of them with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_LARGER = 1.25
"""How much longer than its longest target a region must be, on one axis, to hold several side by side."""


def split(boxes: Array, predicted: Array) -> Array:
    """Boxes (m', 4) in which each region (m, 4) that holds several of the targets (n, 4) is cut.

    Boxes are centre x, y, width, height. A region no larger than one target stays whole: what is hidden
    behind another object has not been seen. Without a region to cut, `boxes` itself is given back.
    """
    if len(boxes) == 0 or len(predicted) < 2:
        return boxes
    holder = _holder(boxes, predicted)
    parts: list[Array] = []
    whole = np.ones(len(boxes), np.bool_)
    for j in np.unique(holder[holder >= 0]):
        held = predicted[holder == j]
        if len(held) > 1 and np.any(boxes[j, 2:] > _LARGER * held[:, 2:].max(axis=0)):
            whole[j] = False
            parts.append(_cut(boxes[j], held))
    return np.concatenate([boxes[whole], *parts]) if parts else boxes


def _holder(boxes: Array, predicted: Array) -> NDArray[np.intp]:
    """The region that covers most of each target and its centre (n,), -1 for none."""
    low, high = _corners(boxes)
    own_low, own_high = _corners(predicted)
    sides = np.minimum(high, own_high[:, None]) - np.maximum(low, own_low[:, None])
    shared = np.prod(np.maximum(sides, 0.0), axis=2)
    centre = predicted[:, None, :2]
    shared[~np.all((centre >= low) & (centre <= high), axis=2)] = 0.0
    best = shared.argmax(axis=1)
    return np.where(shared[np.arange(len(predicted)), best] > 0.0, best, -1)


def _cut(region: Array, held: Array) -> Array:
    """One box for each of the targets (k, 4)."""
    low, high = _corners(held)
    first = low.min(axis=0)
    factor = region[2:] / (high.max(axis=0) - first)
    centres = region[:2] - 0.5 * region[2:] + (held[:, :2] - first) * factor
    return np.hstack([centres, held[:, 2:] * factor])


def _corners(boxes: Array) -> tuple[Array, Array]:
    return boxes[:, :2] - 0.5 * boxes[:, 2:], boxes[:, :2] + 0.5 * boxes[:, 2:]
