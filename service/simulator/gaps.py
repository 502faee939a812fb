"""Stretches of the belt on which nothing lies, by where on the belt they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lumpwatch.service.simulator.spec import FeedSpec

_STREAM = 20
_EDGE_MM = 150.0
"""The bed thins out over so much of the belt."""


class Gaps:
    """Where a place on the belt is what the belt had come when that place passed y = 0, mm."""

    def __init__(self, spec: FeedSpec) -> None:
        self._every = spec.empty_every_s * spec.belt_speed_mm_s
        self._length = spec.empty_duration_s * spec.belt_speed_mm_s
        self._rng = np.random.default_rng([spec.seed, _STREAM])
        self._starts: list[float] = []
        self._horizon = 0.0

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return self._every > 0

    def cover(self, places: ArrayLike) -> NDArray[np.float32]:
        """How much of the bed lies at these places, 0 to 1 (n,)."""
        at = np.asarray(places, float)
        covered = np.ones(at.shape, np.float32)
        if not self.any or not at.size:
            return covered
        self._extend(float(at.max()))
        low = float(at.min()) - self._length
        for start in self._starts:
            if start >= low:
                inside = np.minimum(at - start, start + self._length - at)
                covered = np.minimum(covered, np.clip(1.0 - inside / _EDGE_MM, 0.0, 1.0).astype(np.float32))
        return covered

    def bare(self, place: float, size_mm: float) -> bool:
        """Whether a rock of that size would lie in a gap, or reach into one."""
        return self.any and bool((self.cover(np.array([-0.5, 0.0, 0.5]) * size_mm + place) < 1.0).any())

    def _extend(self, until: float) -> None:
        while self._horizon <= until:
            start = self._horizon + 0.25 * self._every + float(self._rng.exponential(0.75 * self._every))
            self._starts.append(start)
            self._horizon = start + self._length
