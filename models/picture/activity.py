"""How much is new in pictures over seconds.

A live sensor has noise in every pixel, whether the belt runs or stands, so no picture comes twice; a frozen
one does. Where it is decoded from the same bits it is the same as the one before. Where a recorder codes it
again, its coder adds changes of its own, which may be larger than a sensor's noise, but it comes back to what
it made of it one key frame earlier. So what counts is the change against the most similar of the pictures of
the last seconds.

Two things stand between. A clock that is burnt in changes a few tiles of a frozen picture, so the measure is
the change that a stated share of the tiles exceeds. A coder may send nothing for a scene that stands still
until its next key frame, so each tile counts with its largest change over the window: the measure tells apart
whatever a key frame refreshes.
"""

from __future__ import annotations

from collections import deque
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.picture.tiles import grid, tile_means
from lumpwatch.models.roi import Image

CLOCK_SHARE = 0.1
"""Share of the tiles that may change without the rest being alive, such as a burnt-in clock."""
REMEMBERED_S = 5.0
"""So far back a picture is looked for that was the same: longer than from one key frame to the next."""
_MOST_REMEMBERED = 32
_LIVELY = 8.0  # grey levels: where so much has changed since the last picture, none before it is looked at
_STRIDE = 2  # every second row and column: leaving pixels out keeps the noise, a mean would take it away


class Activity:
    """The mean absolute change, in grey levels, that `CLOCK_SHARE` of the tiles exceed within `window_s`."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._shape: tuple[int, ...] = ()
        self._seen: deque[tuple[float, Image]] = deque(maxlen=_MOST_REMEMBERED)
        self._changes: deque[tuple[float, NDArray[np.float32]]] = deque()

    def add(self, time_s: float, picture: Image) -> float | None:
        """The next picture (h, w); None until there are two to compare."""
        if self._seen and picture.shape != self._shape:
            self._seen.clear()
            self._changes.clear()
        self._shape = picture.shape
        thinned = np.ascontiguousarray(picture[::_STRIDE, ::_STRIDE])
        # The last one stays however long ago: pictures that seldom come can be frozen too.
        while len(self._seen) > 1 and self._seen[0][0] <= time_s - REMEMBERED_S:
            self._seen.popleft()
        compared = bool(self._seen)
        if compared:
            self._changes.append((time_s, self._least_change(thinned)))
        self._seen.append((time_s, thinned))
        if not compared:
            return None
        while self._changes[0][0] <= time_s - self._window_s:
            self._changes.popleft()
        return _exceeded(np.max([tiles for _, tiles in self._changes], axis=0))

    def _least_change(self, thinned: Image) -> NDArray[np.float32]:
        """Of each tile, against the most similar of the pictures before (n,)."""
        least = self._change(self._seen[-1][1], thinned)
        level = _exceeded(least)
        if level > _LIVELY:
            return least
        for _, earlier in islice(reversed(self._seen), 1, None):
            if level == 0.0:
                break
            change = self._change(earlier, thinned)
            if _exceeded(change) < level:
                least, level = change, _exceeded(change)
        return least

    def _change(self, earlier: Image, thinned: Image) -> NDArray[np.float32]:
        change = cv2.absdiff(earlier, thinned).astype(np.float32)
        return tile_means(change, *grid(self._shape)).ravel()


def _exceeded(tiles: NDArray[np.float32]) -> float:
    """What `CLOCK_SHARE` of the tiles exceed."""
    k = len(tiles) - 1 - int(CLOCK_SHARE * len(tiles))
    return float(np.partition(tiles, k)[k])
