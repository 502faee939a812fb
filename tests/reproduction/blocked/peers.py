"""What one would try first: a mouth in which nothing moves, by frame difference or by OpenCV's MOG2.

Both get the same cut, the same feed state, the same delay, and the threshold that parts a clip of bridges from normal
crushing best.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from lumpwatch.models.roi import Image, make_roi

DELAY_S = 8.0
_DIFFERS = 10.0
"""Grey levels, about three times the noise."""


class Peer:
    """Blocked while less than `limit` of the mouth has moved for the delay, as long as the feed runs."""

    def __init__(self, name: str, moving: Callable[[Image], float], limit: float | None) -> None:
        self.name, self._moving, self._limit = name, moving, limit
        self._still_s, self._last_s = 0.0, 0.0
        self._smooth = 1.0
        self.active = False
        """Whether it calls the mouth blocked."""
        self.raises = False
        """Whether it raised its alarm with the last picture."""

    def step(self, gray: Image, t: float, *, runs: bool) -> float:
        """The next picture of the mouth; the share that moves, over the last second."""
        dt, self._last_s = t - self._last_s, t
        self._smooth += min(dt, 1.0) * (self._moving(gray) - self._smooth)
        self.raises = False
        if self._limit is None:
            return self._smooth
        if self._smooth >= self._limit:
            self._still_s, self.active = 0.0, False
        elif runs:
            self._still_s += dt
            self.raises = self._still_s >= DELAY_S and not self.active
            self.active |= self.raises
        return self._smooth


def peers(
    polygon: tuple[tuple[float, float], ...], width: int, height: int, limits: dict[str, float] | None
) -> tuple[Peer, ...]:
    """Both, for pictures of that size."""
    roi = make_roi(polygon, width, height, 320)
    mog = cv2.createBackgroundSubtractorMOG2(history=50, varThreshold=16, detectShadows=False)
    before: list[Image] = []

    def difference(picture: Image) -> float:
        gray = np.asarray(cv2.GaussianBlur(roi.cut(picture), (0, 0), 1.0), np.uint8)
        moved = 1.0 if not before else float((cv2.absdiff(gray, before[-1]) > _DIFFERS).mean())
        before[:] = [gray]
        return moved

    def foreground(picture: Image) -> float:
        return float((mog.apply(roi.cut(picture)) > 0).mean())

    return tuple(
        Peer(name, moving, None if limits is None else limits[name])
        for name, moving in (("frame difference", difference), ("MOG2", foreground))
    )


def best_limit(moving: list[tuple[float, bool]]) -> float:
    """The limit that parts what moves in a free mouth from what moves in a blocked one with the fewest errors."""
    values = np.array([value for value, _ in moving])
    blocked = np.array([is_so for _, is_so in moving])
    candidates = np.unique(np.quantile(values, np.linspace(0.0, 1.0, 101)))
    errors = [float((values[blocked] >= one).mean() + (values[~blocked] < one).mean()) for one in candidates]
    return float(candidates[int(np.argmin(errors))])
