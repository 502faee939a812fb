"""What stays in place while the belt around it moves: on the lens, burnt into the picture, or stuck.

An insect, a drop, a sticker, a reflection, a logo or a clock may look like a lump, but it does not ride. So a box
is compared with the same place in an earlier picture, one from before the belt around it moved by most of
the box: what is on the belt has left the place by then, and what still looks the same there stands. How far the belt
has moved is the sum of the median motions of points around the box (pyramidal Lucas-Kanade, Bouguet 2001), kept where
tracking back leads to where it began. Where nothing around it moves, or nothing can be followed, nothing is said:
what lies on a belt that stands still is no stranger to it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

Boxes = NDArray[np.float64]

LONGEST_LOOK_S = 4.0
"""So far back places are looked at."""
_SIDE = 160  # longer side of the pictures that are compared, px
_EVERY_S = 0.125
_LONGEST_GAP_S = 1.0  # after that the belt may have moved by anything
_GRID = 8  # between followed points, px
_LEAST_POINTS = 8
_BACK_PX = 0.5  # tracked there and back a point must end so near to where it began
_WINDOW, _LEVELS = (15, 15), 3
_LEAVES = 0.75  # share of the shorter side of the box by which the belt must have moved
_FAR = 3.0  # times that: a box that jumps to and fro has then stayed, or ridden, without doubt
_LEAST_MOVED_PX = 6.0
_TREMBLES_PX = 3  # what stands may tremble by so much
_SAME, _ANOTHER = 0.6, 0.4  # correlation from which, and below which, a place looks the same
_LEAST_DEVIATION = 3.0  # grey levels: in less nothing can be recognised


@dataclass(slots=True)
class _Seen:
    time_s: float
    picture: Image
    moved: NDArray[np.float32] | None = field(default=None)
    """How far each point of the grid has moved since the picture before (n, 2), NaN where not known; None: not yet
    looked."""


@dataclass(frozen=True, slots=True)
class PlaceLook:
    """What the place of a box looked like before the belt around it had moved by most of the box."""

    since_s: float
    """When that was."""
    moved: NDArray[np.float64]
    """How far the belt has moved since then (2,), working px."""
    same: bool | None
    """Whether the place looked the same then: True: something stands there. False: it does not. None: unclear."""
    far_since_s: float
    """As `since_s`, but before the belt had moved by several times as much, as far as that is known."""
    far_moved: NDArray[np.float64]
    """How far it has moved since then (2,), working px."""


class StandingMeter:
    """Remembers the working pictures of one region over seconds; `mask` (h, w) is 1 inside its polygon."""

    def __init__(self, mask: Image) -> None:
        self._scale = min(1.0, _SIDE / max(mask.shape))
        small = self._reduced(mask)
        y, x = np.mgrid[_GRID // 2 : small.shape[0] : _GRID, _GRID // 2 : small.shape[1] : _GRID]
        inside = small[y, x] > 0
        self._points = np.column_stack([x[inside], y[inside]]).astype(np.float32)
        self._seen: deque[_Seen] = deque()

    def add(self, time_s: float, picture: Image) -> None:
        """The next working picture (h, w); times rise."""
        if self._seen:
            since_s = time_s - self._seen[-1].time_s
            if since_s < _EVERY_S - 1e-3:
                return
            if since_s > _LONGEST_GAP_S:
                self._seen.clear()
        self._seen.append(_Seen(time_s, self._reduced(picture)))
        while self._seen[0].time_s < time_s - LONGEST_LOOK_S:
            self._seen.popleft()

    def look(self, boxes: Boxes) -> tuple[PlaceLook | None, ...]:
        """The place of each of the boxes (n, 4; centre and size in working pixels); None where the belt around it has
        not moved by enough, or that cannot be told.
        """
        return tuple(self._look(box, np.delete(boxes, i, axis=0)) for i, box in enumerate(boxes))

    def _look(self, box: Boxes, others: Boxes) -> PlaceLook | None:
        around = self._around(box * self._scale, others * self._scale)
        needed = max(_LEAVES * self._scale * float(min(box[2], box[3])), _LEAST_MOVED_PX)
        moved = np.zeros(2)
        near: tuple[int, NDArray[np.float64]] | None = None
        k = len(self._seen)
        while k > 1 and math.hypot(*moved) < _FAR * needed:
            step = self._motion(k - 1)[around]
            step = step[np.isfinite(step[:, 0])]
            if len(step) < _LEAST_POINTS:
                break
            k -= 1
            moved = moved + middle(step)
            if near is None and math.hypot(*moved) >= needed:
                near = k - 1, moved
        if near is None:
            return None
        since, by = near
        same = self._same(box * self._scale, by, since)
        return PlaceLook(
            self._seen[since].time_s, by / self._scale, same, self._seen[k - 1].time_s, moved / self._scale
        )

    def _around(self, box: Boxes, others: Boxes) -> NDArray[np.bool_]:
        """Which points lie around the box, and on no other."""
        away = np.abs(self._points - box[:2])
        around = (away < 1.25 * box[2:]).all(axis=1) & ~(away < 0.6 * box[2:]).all(axis=1)
        for other in others:
            around &= ~(np.abs(self._points - other[:2]) < 0.6 * other[2:]).all(axis=1)
        return np.asarray(around, bool)

    def _motion(self, k: int) -> NDArray[np.float32]:
        now, before = self._seen[k], self._seen[k - 1]
        if now.moved is None:
            now.moved = _follow(before.picture, now.picture, self._points)
        return now.moved

    def _same(self, box: Boxes, moved: NDArray[np.float64], k: int) -> bool | None:
        """Whether the box looks as the same place did then, and not as the place that the belt came from."""
        now, then = self._seen[-1].picture, self._seen[k].picture
        patch = _cut(now, box, 0)
        if min(patch.shape) < 4 or float(patch.std()) < _LEAST_DEVIATION:
            return None
        here = _likeness(patch, _cut(then, box, _TREMBLES_PX))
        came = box.copy()
        came[:2] -= moved
        there = _likeness(patch, _cut(then, came, _TREMBLES_PX))
        if here >= _SAME and here > there:
            return True
        return False if here < _ANOTHER or there > here else None

    def _reduced(self, picture: Image) -> Image:
        size = (max(round(picture.shape[1] * self._scale), 1), max(round(picture.shape[0] * self._scale), 1))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(small, dtype=np.uint8)


def middle(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The median of each column of (n, k), n at least 1: `numpy.median` takes several times as long for so few."""
    ordered, half = np.sort(values, axis=0), len(values) // 2
    return ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / np.float32(2)


def _follow(before: Image, now: Image, points: NDArray[np.float32]) -> NDArray[np.float32]:
    """How far each point has moved (n, 2), NaN where it cannot be followed there and back."""
    if not len(points):
        return np.zeros((0, 2), np.float32)
    start = points.reshape(-1, 1, 2)
    ahead, found = _track(before, now, start)
    back, again = _track(now, before, ahead)
    good = (found.ravel() > 0) & (again.ravel() > 0)
    good &= np.abs(back - start).max(axis=(1, 2)) < _BACK_PX
    moved = (ahead - start).reshape(-1, 2)
    moved[~good] = np.nan
    return np.asarray(moved, np.float32)


def _track(
    before: Image, now: Image, points: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Where points (n, 1, 2) went, and 1 for each that was found (n, 1)."""
    out = np.empty_like(points)
    ahead, found, _ = cv2.calcOpticalFlowPyrLK(before, now, points, out, winSize=_WINDOW, maxLevel=_LEVELS)
    return np.asarray(ahead, np.float32), np.asarray(found, np.uint8)


def _cut(picture: Image, box: Boxes, margin: int) -> Image:
    """The part of the picture under a box (centre and size), `margin` wider on every side where there is picture."""
    left, top = np.round(box[:2] - box[2:] / 2).astype(int) - margin
    right, bottom = np.round(box[:2] + box[2:] / 2).astype(int) + margin
    return picture[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]


def _likeness(patch: Image, where: Image) -> float:
    """The largest normalised correlation of the patch within a larger picture; 0 where it does not fit."""
    height, width = (min(a, b) for a, b in zip(patch.shape, where.shape, strict=True))
    if min(height, width) < 4:
        return 0.0
    found = cv2.matchTemplate(where, patch[:height, :width], cv2.TM_CCOEFF_NORMED)
    best = float(np.max(found))
    return best if np.isfinite(best) else 0.0
