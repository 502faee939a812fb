"""Tracks: boxes with a frame and an id."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True)
class Tracks:
    """Boxes of any number of tracks, in any order. Build it with `tracks_of`, which checks."""

    frames: NDArray[np.int64]
    """Frame of each box (n,)."""
    ids: NDArray[np.int64]
    """Track of each box (n,); at most one box a frame and track."""
    boxes: NDArray[np.float64]
    """Left, top, width, height (n, 4), px; width and height positive."""


def tracks_of(frames: ArrayLike, ids: ArrayLike, boxes: ArrayLike) -> Tracks:
    """Tracks from frames (n,), ids (n,) and boxes (n, 4) by left, top, width, height; n may be 0.

    Raises ValueError where the shapes do not fit, a frame or id is not whole, a number is not finite,
    a box has no area, or a track has two boxes in one frame.
    """
    when, who, where = _whole(frames, "frames"), _whole(ids, "ids"), np.array(boxes, dtype=np.float64)
    if where.size == 0:
        where = where.reshape(0, 4)
    if when.ndim != 1 or who.shape != when.shape or where.shape != (len(when), 4):
        shapes = f"{when.shape}, {who.shape} and {where.shape}"
        raise ValueError(f"frames, ids and boxes must be (n,), (n,) and (n, 4), not {shapes}")
    if not np.isfinite(where).all():
        raise ValueError("boxes must be finite")
    if not (where[:, :2] + where[:, 2:] > where[:, :2]).all():
        raise ValueError("width and height of a box must be positive")
    order = np.lexsort((who, when))
    same = (np.diff(when[order]) == 0) & (np.diff(who[order]) == 0)
    if same.any():
        twice = order[np.argmax(same)]
        raise ValueError(f"track {who[twice]} has two boxes in frame {when[twice]}")
    return Tracks(when, who, where)


def _whole(values: ArrayLike, name: str) -> NDArray[np.int64]:
    given = np.asarray(values)
    if given.size and given.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be whole numbers of at most 64 bits")
    if not np.isfinite(given).all() or not np.array_equal(given, np.trunc(given)):
        raise ValueError(f"{name} must be whole numbers")
    if given.size and np.abs(given.astype(np.float64)).max() > 2.0**53:
        raise ValueError(f"{name} must be within 2^53")
    return given.astype(np.int64)
