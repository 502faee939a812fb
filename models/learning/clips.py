"""Labelled tracks of several clips, brought to one frame interval."""

from __future__ import annotations

import numpy as np

from lumpwatch.models.learning.tracks import Track, split_at_gaps


def at_interval(track: Track, interval_s: float, wanted_s: float) -> list[Track]:
    """The track as a camera with another frame interval would have seen it, one part a run without gaps.

    Boxes are interpolated linearly; a frame's model is that of the labelled frame nearest to it. A run
    that is too short for two frames is left out.
    """
    if abs(wanted_s / interval_s - 1.0) < 0.02:
        return [track]
    parts = []
    for run in split_at_gaps(track):
        times = run.frames * interval_s
        first, last = np.ceil(times[0] / wanted_s - 1e-9), np.floor(times[-1] / wanted_s + 1e-9)
        frames = np.arange(int(first), int(last) + 1)
        if len(frames) < 2:
            continue
        boxes = np.column_stack([np.interp(frames * wanted_s, times, column) for column in run.boxes.T])
        nearest = np.abs(times[None, :] - frames[:, None] * wanted_s).argmin(axis=1)
        labels = None if run.labels is None else run.labels[nearest]
        parts.append(Track(frames.astype(np.intp), boxes, labels))
    return parts
