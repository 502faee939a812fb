"""How much changes over seconds.

A live sensor has noise in every pixel, whether the belt runs or stands; a frozen picture has none: what is
decoded is the same to the bit, or differs by what a coder adds. Two things stand between. A clock that is
burnt in changes a few tiles of a frozen picture, so the measure is the change that a stated share of the
tiles exceeds. A coder may send nothing for a scene that stands still until its next key frame, so each tile
counts with its largest change over the window: the measure tells apart whatever a key frame refreshes.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from models.quality.tiles import grid, tile_means
from models.roi import Image

CLOCK_SHARE = 0.1
"""Share of the tiles that may change without the rest being alive, such as a burnt-in clock."""
LONGEST_GAP_S = 1.5
"""Pictures further apart are not compared: the window begins anew."""


class Activity:
    """The mean absolute change, in grey levels, that `CLOCK_SHARE` of the tiles exceed within `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._last: tuple[float, Image] | None = None
        self._changes: deque[tuple[float, NDArray[np.float32]]] = deque()

    def add(self, time_s: float, picture: Image) -> float | None:
        """The next picture (h, w); None until there are two to compare."""
        last, self._last = self._last, (time_s, picture)
        if last is None or last[1].shape != picture.shape or time_s - last[0] > LONGEST_GAP_S:
            self._changes.clear()
            return None
        change = cv2.absdiff(last[1], picture).astype(np.float32)
        self._changes.append((time_s, tile_means(change, *grid(picture.shape)).ravel()))
        while self._changes[0][0] <= time_s - self._window_s:
            self._changes.popleft()
        largest = np.max([tiles for _, tiles in self._changes], axis=0)
        k = len(largest) - 1 - int(CLOCK_SHARE * len(largest))
        return float(np.partition(largest, k)[k])
