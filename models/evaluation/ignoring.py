"""Boxes of a result that lie on what the truth leaves open: counted neither for nor against it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation.pairing import overlaps
from lumpwatch.models.evaluation.tracks import Tracks

LEAST_SHARE = 0.5
"""Share of a box that must lie on one ignored box."""


def without_ignored(result: Tracks, truth: Tracks, ignored: Tracks, threshold: float) -> Tracks:
    """The result without the boxes that lie on an ignored box and on no true one.

    A box lies on a true one where their overlap reaches `threshold`, and on an ignored one where that covers half
    of it (as in the evaluation of MOTChallenge, where what is hardly visible counts neither way).
    """
    kept: NDArray[np.bool_] = np.ones(len(result.frames), dtype=np.bool_)
    for frame in np.unique(ignored.frames):
        rows = np.flatnonzero(result.frames == frame)
        boxes, open_boxes = result.boxes[rows], ignored.boxes[ignored.frames == frame]
        true = overlaps(boxes, truth.boxes[truth.frames == frame])
        right = (true >= max(threshold, np.finfo(float).tiny)).any(axis=1)
        kept[rows] = right | ~(_shares(boxes, open_boxes) >= LEAST_SHARE).any(axis=1)
    return Tracks(result.frames[kept], result.ids[kept], result.boxes[kept])


def _shares(boxes: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of each box (n, 4) that lies on each of the others (m, 4): (n, m)."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum((boxes[:, :2] + boxes[:, 2:])[:, None], (others[:, :2] + others[:, 2:])[None])
    shared = np.maximum(high - low, 0.0).prod(axis=2)
    return np.asarray(shared / boxes[:, 2:].prod(axis=1)[:, None])
