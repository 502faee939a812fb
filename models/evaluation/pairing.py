"""Result and truth brought together: overlaps of boxes, frames of tracks, one-to-one assignments.

The overlap of two boxes is the area of their intersection over that of their union,
|G ∩ D| / |G ∪ D|, 0 to 1: the spatial overlap of Kasturi et al. (PAMI 2009). Assignments are those of
the Hungarian algorithm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import check_shape
from lumpwatch.models.evaluation.tracks import Tracks

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class FramePair:
    """What truth and result say of one frame."""

    truth: Indices
    """Index of the track of each true box (g,), from 0."""
    result: Indices
    """Index of the track of each box of the result (d,), from 0."""
    overlap: Array
    """Overlap of each true box with each of the result (g, d)."""


@dataclass(frozen=True, slots=True)
class Pairing:
    """Truth and result, frame by frame."""

    frames: tuple[FramePair, ...]
    """The frames in which either has a box, in order of time."""
    truth_tracks: int
    truth_boxes: int
    result_tracks: int
    result_boxes: int


def pair(result: Tracks, truth: Tracks) -> Pairing:
    """Bring a result and its truth together frame by frame."""
    moments = np.union1d(result.frames, truth.frames)
    truth_tracks, truth_parts = _by_frame(truth, moments)
    result_tracks, result_parts = _by_frame(result, moments)
    frames = tuple(
        FramePair(true, found, overlaps(true_boxes, found_boxes))
        for (true, true_boxes), (found, found_boxes) in zip(truth_parts, result_parts, strict=True)
    )
    return Pairing(frames, truth_tracks, len(truth.boxes), result_tracks, len(result.boxes))


def overlaps(a: Array, b: Array) -> Array:
    """Overlap of each box of `a` (n, 4) with each of `b` (m, 4): shape (n, m).

    Raises ValueError for boxes of another shape.
    """
    check_shape(a, ("n", 4), "a")
    check_shape(b, ("m", 4), "b")
    a_start, a_end, b_start, b_end = a[:, :2], a[:, :2] + a[:, 2:], b[:, :2], b[:, :2] + b[:, 2:]
    shared = np.minimum(a_end[:, None], b_end) - np.maximum(a_start[:, None], b_start)
    intersection = np.maximum(shared, 0.0).prod(axis=2)
    # Areas from the same edges as the intersection, so that equal boxes overlap by exactly 1.
    areas = (a_end - a_start).prod(axis=1)[:, None] + (b_end - b_start).prod(axis=1)
    return intersection / (areas - intersection)


def reaches(overlap: Array, threshold: float) -> Mask:
    """Which boxes may be paired: those that share an area and overlap by `threshold` or more."""
    return (overlap >= threshold) & (overlap > 0.0)


def assign(score: Array, allowed: Mask) -> tuple[Indices, Indices]:
    """Rows and columns of the one-to-one assignment of allowed pairs with the largest sum of `score` >= 0."""
    # A monitor, which assigns nothing here, need not load it.
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.where(allowed, score, 0.0), maximize=True)
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]


def track_overlaps(pairing: Pairing, threshold: float | None) -> tuple[Array, Array]:
    """For each true track and each of the result (G, D): the overlap summed over frames, and the number
    of frames in which either is present. With a threshold an overlap counts as 1 where it reaches it,
    else as 0.
    """
    shape = pairing.truth_tracks, pairing.result_tracks
    shared, both = np.zeros(shape), np.zeros(shape)
    truth_frames, result_frames = np.zeros(shape[0]), np.zeros(shape[1])
    for frame in pairing.frames:
        truth_frames[frame.truth] += 1.0
        result_frames[frame.result] += 1.0
        here = np.ix_(frame.truth, frame.result)
        both[here] += 1.0
        shared[here] += frame.overlap if threshold is None else reaches(frame.overlap, threshold)
    return shared, truth_frames[:, None] + result_frames - both


def ratio(part: float, whole: float) -> float:
    """The quotient, and NaN where there is nothing to divide by."""
    return part / whole if whole else float("nan")


def _by_frame(tracks: Tracks, moments: NDArray[np.int64]) -> tuple[int, list[tuple[Indices, Array]]]:
    """The number of tracks, and for each moment the track indices (k,) and boxes (k, 4)."""
    ids, index = np.unique(tracks.ids, return_inverse=True)
    order = np.argsort(tracks.frames, kind="stable")
    index, boxes = index[order], tracks.boxes[order]
    starts = np.searchsorted(tracks.frames[order], moments)
    return len(ids), list(zip(np.split(index, starts)[1:], np.split(boxes, starts)[1:], strict=True))
