"""Slow estimates: one picture decides nothing."""

from __future__ import annotations

from collections import deque
from statistics import median


class SlowMedian:
    """The median of the values of the last `window_s`; half of them wrong change nothing."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._values: deque[tuple[float, float]] = deque()

    def add(self, time_s: float, value: float) -> float:
        """The next value; times rise. Returns the median with it."""
        self._values.append((time_s, value))
        while self._values[0][0] <= time_s - self._window_s:
            self._values.popleft()
        return median(v for _, v in self._values)

    @property
    def count(self) -> int:
        """How many values the window holds."""
        return len(self._values)

    @property
    def range(self) -> float:
        """From the smallest to the largest of the values; 0 without values."""
        values = [v for _, v in self._values]
        return max(values) - min(values) if values else 0.0

    @property
    def spread(self) -> float:
        """Median distance of the values from their median; 0 without values."""
        if not self._values:
            return 0.0
        middle = median(v for _, v in self._values)
        return median(abs(v - middle) for _, v in self._values)


class JumpDetector:
    """Says when the mean level of a picture jumps, as it does when a camera changes its exposure."""

    def __init__(self, factor: float, within_s: float = 0.5) -> None:
        self._factor, self._within_s = factor, within_s
        self._means: deque[tuple[float, float]] = deque()

    def add(self, time_s: float, mean: float) -> bool:
        """Whether the mean is `factor` times larger or smaller than any within the last `within_s`."""
        while self._means and self._means[0][0] < time_s - self._within_s - 1e-6:
            self._means.popleft()
        level = max(mean, 1.0)
        before = [value for _, value in self._means]
        self._means.append((time_s, level))
        return bool(before) and (level > self._factor * min(before) or self._factor * level < max(before))
