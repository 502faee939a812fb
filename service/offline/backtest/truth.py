"""The labelled lumps of a video, and the frames at which an estimate lies on them.

An estimate lies on a lump where the intersection over union of their boxes exceeds OVERLAP. Between two
labelled frames of a lump its box is interpolated linearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import overlaps
from lumpwatch.service.offline.backtest.record import Array, Indices, Recording
from lumpwatch.service.storage import Box

OVERLAP = 0.3
LipFrom = Literal["fall label", "last label"]


@dataclass(frozen=True, slots=True)
class Lump:
    """One labelled lump that comes through the ROI; times are seconds from the start of the video."""

    track: int
    first_frame: int
    lip_frame: int
    first_s: float
    last_s: float
    """First and last label."""
    lip_s: float
    """When it reaches the lip."""
    lip_from: LipFrom
    """What says so: the first label of the fall, or for want of one the last label."""
    counted: bool
    """Whether the video shows enough of it: its end, and a lip late enough to be announced in time."""
    on: Indices
    """Indices of the recorded frames at which an estimate lies on it."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What the labels state of a recording."""

    lumps: tuple[Lump, ...]
    outside: int
    """Labelled tracks whose centre never comes into the ROI."""


def truth_of(
    recording: Recording,
    boxes: Sequence[Box],
    polygon: Sequence[tuple[float, float]],
    fall_model: str,
    least_warning_s: float,
) -> Truth:
    """The lumps of a video. `boxes` are ordered by track and frame, `polygon` is relative to the picture."""
    corners = (np.array(polygon) * (recording.width, recording.height)).astype(np.float32)
    tracks = [list(group) for _, group in groupby(boxes, key=lambda box: box.track)]
    inside = [track for track in tracks if any(_is_inside(corners, box) for box in track)]
    lumps = tuple(_lump(recording, track, fall_model, least_warning_s) for track in inside)
    return Truth(lumps, len(tracks) - len(inside))


def near(
    times: Array, lumps: Sequence[Lump], before_s: float = 0.0, after_s: float = 0.0
) -> NDArray[np.bool_]:
    """At which times a labelled lump is there, or comes within `before_s`, or has gone for `after_s` at most."""
    mask = np.zeros(len(times), dtype=np.bool_)
    for lump in lumps:
        # Times are multiples of a frame interval: the margin keeps rounding from deciding.
        start = np.searchsorted(times, lump.first_s - before_s - 1e-6)
        mask[start : np.searchsorted(times, lump.last_s + after_s + 1e-6)] = True
    return mask


def _is_inside(corners: NDArray[np.float32], box: Box) -> bool:
    return cv2.pointPolygonTest(corners, (box.x + box.w / 2, box.y + box.h / 2), measureDist=False) >= 0


def _lump(recording: Recording, track: Sequence[Box], fall_model: str, least_warning_s: float) -> Lump:
    fall = next((box.frame for box in track if box.model == fall_model), None)
    first, last = track[0].frame, track[-1].frame
    lip = last if fall is None else fall
    first_s, last_s, lip_s = (
        float(s) for s in np.interp((first, last, lip), recording.frames, recording.times)
    )
    cut_off = fall is None and last >= recording.length
    return Lump(
        track[0].track,
        first,
        lip,
        first_s,
        last_s,
        lip_s,
        "last label" if fall is None else "fall label",
        not cut_off and lip_s > least_warning_s - 1e-6,
        _on(recording, track),
    )


def _on(recording: Recording, track: Sequence[Box]) -> Indices:
    labelled = np.array([(box.x, box.y, box.w, box.h) for box in track])
    numbers = [box.frame for box in track]
    frame = recording.frames[recording.owner]
    there = np.flatnonzero((frame >= numbers[0]) & (frame <= numbers[-1]))
    true = np.column_stack([np.interp(frame[there], numbers, column) for column in labelled.T])
    found = recording.boxes[there]
    hits = [overlaps(found[k : k + 1], true[k : k + 1])[0, 0] > OVERLAP for k in range(len(there))]
    return np.unique(recording.owner[there[np.array(hits, dtype=np.bool_)]])
