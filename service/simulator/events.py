"""Random moments: a few each minute, whenever they are asked for the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


class Moments:
    """A Poisson process, from t = 0, whose moments keep a quarter of their mean distance apart."""

    def __init__(self, stream: tuple[int, ...], every_s: float) -> None:
        self._rng = np.random.default_rng(stream)
        self._every = every_s
        self._moments: list[tuple[float, float]] = []
        self._horizon = 0.0

    def since(self, t: float, window_s: float) -> Iterator[tuple[float, float]]:
        """For each moment within the last `window_s` seconds: time since then, and its number in 0..1."""
        while self._horizon <= t:
            self._horizon += 0.25 * self._every + self._rng.exponential(0.75 * self._every)
            self._moments.append((self._horizon, float(self._rng.random())))
        for moment, mark in reversed(self._moments):
            if moment <= t - window_s:
                return
            if moment <= t:
                yield t - moment, mark
