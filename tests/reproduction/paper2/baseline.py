"""A plain baseline: regions of OpenCV's background subtraction, linked by off-the-shelf trackers.

The regions come from the same masks as ours; a box is the region's own. Only benchmarks need the
package.
"""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import Tracks, tracks_of
from lumpwatch.models.trackers.foreground import regions
from lumpwatch.models.trackers.imm_pf.observation import STEP
from tests.reproduction.paper2.footage import FPS

LEAST_AREA = 75
"""Pixels of the grid, 300 of the picture: half of the smallest labelled box's body."""
NAMES = ("SORTTracker", "ByteTrackTracker", "OCSORTTracker")


def available() -> bool:
    """Whether the package is installed."""
    return find_spec("trackers") is not None and find_spec("supervision") is not None


def follow(name: str, foreground: NDArray[np.uint8]) -> Tracks:
    """The tracks of a tracker by its name, on masks (frames, h, w) of the grid."""
    import supervision
    import trackers

    tracker = getattr(trackers, name)(frame_rate=FPS)
    rows = []
    for frame, mask in enumerate(foreground, 1):
        boxes = regions(mask, LEAST_AREA) * STEP
        corners = np.hstack([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2])
        found = tracker.update(
            supervision.Detections(
                xyxy=corners.astype(np.float32).reshape(-1, 4),
                confidence=np.ones(len(boxes), np.float32),
                class_id=np.zeros(len(boxes), int),
            )
        )
        if found.tracker_id is None:
            continue
        for (x0, y0, x1, y1), who in zip(found.xyxy, found.tracker_id, strict=True):
            if who >= 0:  # -1: not yet a track
                rows.append((frame, int(who) + 1, x0, y0, x1 - x0, y1 - y0))
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return tracks_of(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:])
