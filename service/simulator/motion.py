"""How far the belt has come: distance(t) = speed * G(running(t)).

`running` is the time without the stops and their short ramps. G' is the factor on the speed: 1, or
drawn anew every so often and reached within a second.
"""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from lumpwatch.service.simulator.spec import FeedSpec

_RAMP_S = 0.4
_CHANGE_S = 1.0


class BeltMotion:
    """Distance and speed of the belt as exact functions of time, so that no frame rate matters."""

    def __init__(self, spec: FeedSpec) -> None:
        self._speed = self.full_speed_mm_s = spec.belt_speed_mm_s
        self._every, self._duration = spec.stop_every_s, spec.stop_duration_s
        self._rng = np.random.default_rng([spec.seed, 1])
        self._starts: list[float] = []
        self._horizon = 0.0
        self._pace = _Pace(spec)

    def distance(self, t: float) -> float:
        """How far the belt has moved since t = 0, mm; before that it ran at its speed."""
        return self._speed * self._pace.sum(self._running(t))

    def speed(self, t: float) -> float:
        """Speed of the belt at time t, mm/s."""
        running = self.running_speed(t)
        if self._every == 0 or t <= 0 or (done := self._stops_until(t)) == 0:
            return running
        s = t - self._starts[done - 1]
        return running * min(max(1 - s / _RAMP_S, (s - self._duration) / _RAMP_S, 0.0), 1.0)

    def running_speed(self, t: float) -> float:
        """Speed at time t, or to which the belt goes back after the stop it is in, mm/s."""
        return self._speed * self._pace.factor(self._running(t))

    def time_at(self, distance: float, before: float) -> float:
        """When the belt had come that far; `before` is a time at which it had come farther."""
        low = min(distance / self._speed, distance / (self._speed * self._pace.fastest), before)
        high = before
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if self.distance(middle) < distance else (low, middle)
        return high

    def _running(self, t: float) -> float:
        if self._every == 0 or t <= 0:
            return t
        done = self._stops_until(t) - 1
        lost = max(done, 0) * self._duration  # the ramps before and after lose half of their time each
        if done >= 0:
            lost += self._lost(t - self._starts[done])
        return t - lost

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


class _Pace:
    """The factor on the belt's speed over its running time, piecewise linear, and its integral."""

    def __init__(self, spec: FeedSpec) -> None:
        self._amplitude, self._every = spec.speed_change, spec.speed_change_every_s
        self.fastest = 1 + self._amplitude
        self._rng = np.random.default_rng([spec.seed, 15])
        self._levels, self._sums = [1.0], [0.0]

    def sum(self, s: float) -> float:
        """Integral of the factor from 0 to s; the factor is 1 before 0."""
        if self._amplitude == 0 or s <= 0:
            return s
        k, x = self._at(s)
        old, new = self._levels[k], self._levels[k + 1]
        ramp = min(x, _CHANGE_S)
        return self._sums[k] + old * ramp + (new - old) * ramp * ramp / (2 * _CHANGE_S) + new * (x - ramp)

    def factor(self, s: float) -> float:
        """The factor at running time s."""
        if self._amplitude == 0 or s <= 0:
            return 1.0
        k, x = self._at(s)
        share = min(x / _CHANGE_S, 1.0)
        return self._levels[k] + (self._levels[k + 1] - self._levels[k]) * share

    def _at(self, s: float) -> tuple[int, float]:
        """Number of the interval that s lies in, and the time since it began."""
        k = int(s // self._every)
        while len(self._levels) < k + 2:
            old, new = self._levels[-1], 1 + self._amplitude * float(self._rng.uniform(-1, 1))
            self._levels.append(new)
            self._sums.append(self._sums[-1] + (old + new) / 2 * _CHANGE_S + new * (self._every - _CHANGE_S))
        return k, s - k * self._every
