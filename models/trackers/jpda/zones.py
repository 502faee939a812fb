"""Where objects come and go, and which way they ought to move (paper 3, section IV-B).

Wrong way: a track goes against the configured direction once its way back from the farthest point that
it had reached along the direction is long enough, lasted long enough and points backwards rather than
sideways. The flag goes by the same rule with the direction turned round. An object that stands
never covers the distance, however its box jitters and however long it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Polygon = Sequence[tuple[float, float]]
_BACKWARDS = 0.5
"""Cosine of the widest angle to the direction at which a way counts as along it."""


@dataclass(frozen=True, slots=True)
class OneWay:
    """The direction that is right, and what it takes to be wrong."""

    direction: tuple[float, float]
    """Along x and y, of any length but zero."""
    distance_px: float = 20.0
    """How far an object moves against the direction before it is flagged."""
    for_s: float = 0.3
    """How long that takes at least."""

    def __post_init__(self) -> None:
        """Raises ValueError for a direction without length, or a distance or time below zero."""
        if not 0.0 < float(np.hypot(*self.direction)) < float("inf"):
            raise ValueError(f"the direction must have a finite length above 0: {self.direction}")
        if not (0.0 < self.distance_px < float("inf") and 0.0 <= self.for_s < float("inf")):
            raise ValueError("one way: the distance must be above 0 and the time not below")


@dataclass(frozen=True, slots=True)
class Heading:
    """What is remembered of a track's way."""

    x: float
    y: float
    """The farthest point reached: along the direction, or against it while the track is flagged."""
    since_s: float = 0.0
    """Time since then."""
    wrong: bool = False


def follow(heading: Heading, x: float, y: float, dt: float, rule: OneWay) -> Heading:
    """The heading after the track was seen at (x, y), `dt` seconds after it was seen last."""
    length = float(np.hypot(*rule.direction))
    back_x, back_y = (c / length * (1.0 if heading.wrong else -1.0) for c in rule.direction)
    moved_x, moved_y = x - heading.x, y - heading.y
    back = moved_x * back_x + moved_y * back_y
    if back <= 0.0:
        return Heading(x, y, 0.0, heading.wrong)
    since = heading.since_s + dt
    far = back >= rule.distance_px and since >= rule.for_s
    if far and back >= _BACKWARDS * float(np.hypot(moved_x, moved_y)):
        return Heading(x, y, 0.0, not heading.wrong)
    return Heading(heading.x, heading.y, since, heading.wrong)


def inside(points: Array, polygons: Sequence[Polygon]) -> NDArray[np.bool_]:
    """Which points (n, 2) lie in any of the polygons, by the even-odd rule (n,)."""
    found = np.zeros(len(points), np.bool_)
    for polygon in polygons:
        corners = np.asarray(polygon, dtype=float)
        start, end = corners, np.roll(corners, -1, axis=0)
        x, y = points[:, 0, None], points[:, 1, None]
        spans = (start[:, 1] > y) != (end[:, 1] > y)
        rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
        crossing = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
        found |= (np.count_nonzero(spans & (x < crossing), axis=1) % 2).astype(np.bool_)
    return found
