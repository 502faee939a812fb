"""Labelled tracks and the training triplets that come from them (paper 1, section 2.2.2).

Each step of a track gives the kinematic state before it, x_{t-1}, and the velocities on both sides;
the model labels alpha_{t-1}, alpha_t are given in the file or inferred by `lumpwatch.models.learning.motion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.state import AX, AY, VX, VY, H, States, W, X, Y, blank


@dataclass(frozen=True, slots=True)
class Track:
    """One object over consecutive frames."""

    frames: NDArray[np.intp]
    """Frame numbers (n,), ascending by one."""
    boxes: NDArray[np.float64]
    """Centre x, y, width and height in working pixels (n, 4)."""
    labels: NDArray[np.intp] | None = None
    """Motion model that led to each frame (n,), -1 where it is not known; None: nothing is known."""


@dataclass(frozen=True, slots=True)
class Samples:
    """Steps of all tracks, one after the other."""

    states: States
    """x_{t-1}: the state before each step (k, 8), with the velocity and acceleration there."""
    velocity: NDArray[np.float64]
    """Velocity after each step (k, 2)."""
    given: NDArray[np.intp]
    """Label of each step from the file (k,), -1 where it is not known."""
    starts: NDArray[np.bool_]
    """True for the first step of a track (k,)."""
    interval_s: float


def split_at_gaps(track: Track) -> list[Track]:
    """The runs of consecutive frames in a track."""
    cuts = np.flatnonzero(np.diff(track.frames) != 1) + 1
    parts = []
    for rows in np.split(np.arange(len(track.frames)), cuts):
        labels = None if track.labels is None else track.labels[rows]
        parts.append(Track(track.frames[rows], track.boxes[rows], labels))
    return parts


def samples(tracks: Sequence[Track], interval_s: float, half_window: int) -> Samples:
    """The steps of all tracks of three frames and more.

    Positions are smoothed by a quadratic over 2 `half_window` + 1 frames, whose derivatives are the
    velocity and acceleration; with 0 the velocity is the plain difference to the frame before, as a
    bounce needs it. Raises ValueError where no track is long enough.
    """
    states, after, given, starts = [], [], [], []
    for track in (part for whole in tracks for part in split_at_gaps(whole)):
        if len(track.frames) < 3:
            continue
        position, velocity, acceleration = _derivatives(track.boxes[:, :2], interval_s, half_window)
        # With plain differences the first frame has no velocity yet, so its step teaches nothing.
        first = 1 if half_window == 0 else 0
        rows = np.arange(first, len(track.frames) - 1)
        state = blank(len(rows))
        state[:, X : Y + 1] = position[rows]
        state[:, VX : VY + 1] = velocity[rows]
        state[:, AX : AY + 1] = acceleration[rows]
        state[:, W : H + 1] = track.boxes[rows, 2:]
        states.append(state)
        after.append(velocity[rows + 1])
        known = np.full(len(rows), -1) if track.labels is None else track.labels[rows + 1]
        given.append(known)
        start = np.zeros(len(rows), dtype=np.bool_)
        start[0] = True
        starts.append(start)
    if not states:
        raise ValueError("no labelled object is seen in three consecutive frames")
    return Samples(
        np.concatenate(states),
        np.concatenate(after),
        np.concatenate(given).astype(np.intp),
        np.concatenate(starts),
        interval_s,
    )


def _derivatives(
    position: NDArray[np.float64], interval: float, half_window: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Position, velocity and acceleration (n, 2) at each frame."""
    n = len(position)
    if half_window == 0:
        velocity = np.vstack([np.zeros((1, 2)), np.diff(position, axis=0) / interval])
        return position, velocity, np.zeros_like(position)
    smooth, velocity, acceleration = (np.empty_like(position) for _ in range(3))
    for i in range(n):
        # Near the ends the window keeps its length and moves inwards: a short one would be noise.
        low = min(max(0, i - half_window), max(0, n - 2 * half_window - 1))
        high = min(n, low + 2 * half_window + 1)
        t = (np.arange(low, high) - i) * interval
        degree = min(2, len(t) - 1)
        design = np.vander(t, degree + 1, increasing=True)
        fit = np.linalg.lstsq(design, position[low:high], rcond=None)[0]
        smooth[i], velocity[i] = fit[0], fit[1]
        acceleration[i] = 2.0 * fit[2] if degree == 2 else 0.0
    return smooth, velocity, acceleration
