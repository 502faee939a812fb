"""What the plant says of a region's feed, beside what is seen of it."""

from __future__ import annotations

from dataclasses import replace

from lumpwatch.service.config import FeedConfig
from lumpwatch.service.core import FeedState, FeedStatus, PlantFeed

_LEAST_MM_S = 30.0
"""Speeds are not compared more finely than this."""


class PlantSignal:
    """Of one region; times are on the clock of decisions."""

    def __init__(self, config: FeedConfig) -> None:
        self._config = config
        self._said: PlantFeed | None = None
        self._differs_s: float | None = None

    def take(self, said: PlantFeed | None) -> None:
        """What the plant says from now on; None: nothing."""
        self._said = said

    def beside(self, seen: FeedStatus, now_s: float) -> FeedStatus:
        """What is seen, with what the plant says and whether they agree."""
        if self._said is not None and now_s >= self._said.until_s:
            self._said = None
        agrees = None if self._said is None else _agrees(seen, self._said, self._config.signal_tolerance)
        if agrees is not False:
            self._differs_s = None
        elif self._differs_s is None:
            self._differs_s = now_s
        return replace(seen, plant=self._said, agrees=agrees)

    def differs(self, now_s: float) -> bool:
        """Whether they have not agreed for so long that someone must know."""
        return self._differs_s is not None and now_s - self._differs_s >= self._config.signal_for_s

    def runs(self, now_s: float) -> bool | None:
        """Whether the feeder runs by the plant's signal; None: it does not say."""
        if self._said is None or now_s >= self._said.until_s:
            return None
        if self._said.runs is not None or self._said.speed_mm_s is None:
            return self._said.runs
        return self._said.speed_mm_s > _LEAST_MM_S


def _agrees(seen: FeedStatus, said: PlantFeed, tolerance: float) -> bool | None:
    """None where there is nothing to compare: of an empty belt nobody sees whether it runs."""
    if seen.state not in (FeedState.RUNNING, FeedState.STOPPED):
        return None
    moves = seen.state is FeedState.RUNNING
    if said.runs is not None and said.runs is not moves:
        return False
    if said.speed_mm_s is not None:
        if not moves:
            return said.speed_mm_s <= _LEAST_MM_S
        if seen.speed_mm_s is not None:
            allowed = max(tolerance * said.speed_mm_s, _LEAST_MM_S)
            return abs(seen.speed_mm_s - said.speed_mm_s) <= allowed
        return said.speed_mm_s > 0.0
    return None if said.runs is None else True
