"""How far the belt has come: a constant speed, interrupted by stops with short ramps."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from service.feed.spec import FeedSpec

_RAMP_S = 0.4


class BeltMotion:
    """Distance and speed of the belt as exact functions of time, so that no frame rate matters."""

    def __init__(self, spec: FeedSpec) -> None:
        self._speed = self.full_speed_mm_s = spec.belt_speed_mm_s
        self._every, self._duration = spec.stop_every_s, spec.stop_duration_s
        self._rng = np.random.default_rng([spec.seed, 1])
        self._starts: list[float] = []
        self._horizon = 0.0

    def distance(self, t: float) -> float:
        """How far the belt has moved since t = 0, mm; before that it ran at its speed."""
        if self._every == 0 or t <= 0:
            return self._speed * t
        done = self._stops_until(t) - 1
        lost = max(done, 0) * self._duration  # the ramps before and after lose half of their time each
        if done >= 0:
            lost += self._lost(t - self._starts[done])
        return self._speed * (t - lost)

    def speed(self, t: float) -> float:
        """Speed of the belt at time t, mm/s."""
        if self._every == 0 or t <= 0 or (done := self._stops_until(t)) == 0:
            return self._speed
        s = t - self._starts[done - 1]
        return self._speed * min(max(1 - s / _RAMP_S, (s - self._duration) / _RAMP_S, 0.0), 1.0)

    def time_at(self, distance: float, before: float) -> float:
        """When the belt had come that far; `before` is a time at which it had come farther."""
        low, high = min(distance / self._speed, before), before
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if self.distance(middle) < distance else (low, middle)
        return high

    def _stops_until(self, t: float) -> int:
        while self._horizon <= t:
            start = self._horizon + 0.25 * self._every + self._rng.exponential(0.75 * self._every)
            self._starts.append(start)
            self._horizon = start + self._duration + _RAMP_S
        return bisect_right(self._starts, t)

    def _lost(self, s: float) -> float:
        """Running time lost `s` seconds after a stop began: ramp down, stand, ramp up."""
        down = min(s, _RAMP_S)
        stand = min(max(s - _RAMP_S, 0.0), self._duration - _RAMP_S)
        up = min(max(s - self._duration, 0.0), _RAMP_S)
        return down * down / (2 * _RAMP_S) + stand + up - up * up / (2 * _RAMP_S)
