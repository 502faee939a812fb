"""Which frames of a camera are decided on: evenly apart and at least so many a second, the others by rule not."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

_TREMBLE = 1.05
"""Intervals may be so much longer: of 29.97 frames a second every third is one of ten."""
_KNOWN = 5
"""Intervals of the camera that its own is the median of."""


@dataclass(frozen=True, slots=True)
class PaceState:
    """What the next choice depends on."""

    last_s: float | None = None
    """Capture of the frame that was decided on last."""
    seen_s: tuple[float, ...] = ()
    """Captures of the camera's last frames."""


@dataclass(slots=True)
class Pace:
    """Takes every frame, every second, every third … of a camera: as few as are `rate_hz` a second, or all.

    A frame is passed over where the next one comes soon enough. Evenly, because filters and training know one interval.
    Who is shown the taken ones only takes them all. Times are captures and rise.
    """

    rate_hz: float | None = None
    """None: every frame."""
    _last_s: float | None = None
    _seen_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KNOWN + 1))

    def take(self, time_s: float) -> bool:
        """Whether the frame captured then is to be decided on."""
        self._seen_s.append(time_s)
        if self.rate_hz is not None and self._last_s is not None:
            next_s = time_s + self._interval_s
            if next_s - self._last_s <= _TREMBLE / self.rate_hz:
                return False
        self._last_s = time_s
        return True

    @property
    def _interval_s(self) -> float:
        seen = list(self._seen_s)
        return median(after - before for before, after in pairwise(seen))

    def state(self) -> PaceState:
        """To go on from."""
        return PaceState(self._last_s, tuple(self._seen_s))

    def restore(self, state: PaceState) -> None:
        """Go on from there."""
        self._last_s = state.last_s
        self._seen_s.clear()
        self._seen_s.extend(state.seen_s)
