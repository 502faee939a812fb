"""What the net is to say of a picture: maps of stride 4, from the map of bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lumpwatch.service.training.model_builder.stock import Ids

STRIDE = 4
BODY_PX, GRAIN_PX = 14.0, 9.0
"""A body is as large as the first at least (root of width times height); what is smaller than the second is ore."""
_LEAST_FILL = 0.35
"""A body fills so much of its box at least; a sliver of a hidden one shows no outline to learn from."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Maps (h / 4, w / 4), and the bodies of a picture."""

    body: NDArray[np.int8]
    """1 on a body, 0 elsewhere, -1 where it is not known."""
    edge: NDArray[np.uint8]
    """1 where an outline passes."""
    sides: NDArray[np.float16]
    """From the cell's middle to the left, upper, right and lower side of its body's box, px (4, h / 4, w / 4)."""
    boxes: NDArray[np.float32]
    """x0, y0, x1, y1 of bodies (n, 4)."""


def truth_of(ids: Ids) -> Truth:
    """The truth of a picture whose pixels belong to the bodies `ids` (h, w)."""
    present = np.zeros(int(ids.max()) + 2, np.bool_)
    present[ids + 1] = True  # SOFT is -1
    numbers = np.flatnonzero(present) - 1
    place = np.zeros(len(present), np.int32)
    place[present] = np.arange(len(numbers))
    inverse = place[ids + 1]
    n = len(numbers)
    windows = ndimage.find_objects(inverse + 1, n)
    y0, y1, x0, x1 = np.array([[r.start, r.stop, c.start, c.stop] for r, c in windows], np.float64).T
    flat = inverse.ravel()
    area = np.bincount(flat, minlength=n)
    box_area = (x1 - x0) * (y1 - y0)
    size = np.sqrt(box_area)
    is_body = numbers > 0
    kind = np.where(is_body & (size >= BODY_PX), 1, np.where(is_body & (size >= GRAIN_PX), -1, 0))
    kind[is_body & (size >= GRAIN_PX) & (area < _LEAST_FILL * box_area)] = -1
    kind[numbers < 0] = -1
    at = inverse[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    outlined = np.where(kind[inverse] == 1, inverse + 1, 0).astype(np.float32)
    cross = np.ones((3, 3), np.uint8)
    edge = (cv2.dilate(outlined, cross) != cv2.erode(outlined, cross)).astype(np.uint8)
    h, w = ids.shape
    blocks = edge.reshape(h // STRIDE, STRIDE, w // STRIDE, STRIDE)
    y, x = np.indices(at.shape) * STRIDE + STRIDE / 2
    sides = np.stack([x - x0[at], y - y0[at], x1[at] - x, y1[at] - y])
    known = kind == 1
    boxes = np.column_stack([x0, y0, x1, y1])[known]
    limits: Any = np.float16
    return Truth(
        kind[at].astype(np.int8),
        blocks.max(axis=(1, 3)),
        np.where(kind[at] == 1, np.clip(sides, 0, 400), 0).astype(limits),
        boxes.astype(np.float32),
    )
