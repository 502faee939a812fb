"""How old decisions were when they were made, hour by hour, as the bus told since this console was started."""

from __future__ import annotations

import math
import threading
from bisect import insort
from collections import OrderedDict

HOUR_S = 3600.0
_HOURS = 7 * 24
_LEVELS = 400
_STEP = 1.03
_LEAST_S = 0.001


class Ages:
    """Counts on a scale of 3 %, from a millisecond on: small, and good enough for percentiles."""

    def __init__(self) -> None:
        self._hours: OrderedDict[int, dict[float, int]] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, age_s: float, wall_s: float) -> None:
        """A decision made at this time, so old."""
        level = _LEAST_S
        if age_s > _LEAST_S:
            steps = min(_LEVELS, math.ceil(math.log(age_s / _LEAST_S) / math.log(_STEP)))
            level = _LEAST_S * _STEP**steps
        with self._lock:
            counts = self._hours.setdefault(int(wall_s // HOUR_S), {})
            counts[level] = counts.get(level, 0) + 1
            while len(self._hours) > _HOURS:
                self._hours.popitem(last=False)

    def percentile(self, hour: int, share: float) -> float | None:
        """Age that this share of an hour's decisions did not exceed, seconds; None where there were none."""
        with self._lock:
            counts = dict(self._hours.get(hour, {}))
        levels: list[float] = []
        for level in counts:
            insort(levels, level)
        wanted = share * sum(counts.values())
        for level in levels:
            wanted -= counts[level]
            if wanted <= 0:
                return level
        return None
