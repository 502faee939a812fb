"""Whether a region has judged enough frames, of late and without a break, to have found a lump.

CLEAR is no default: it is what is said of a region that looked and found nothing. Looking takes frames. Times are
capture times, and what is known follows from the frames alone, so that a replay knows the same.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from lumpwatch.service.config import SightConfig
from lumpwatch.service.core import BlindReason

_ROUNDING_S = 1e-6  # times are multiples of a frame interval


@dataclass(frozen=True, slots=True)
class SightState:
    """What is known of the frames that were judged."""

    judged_s: tuple[float, ...] = ()
    """When the newest of them were captured; `least_frames` at most."""
    since_s: float | None = None
    """The first one after the start, after an outage, or after a failure."""
    run_s: float | None = None
    """The first one since the filter last began anew."""
    run: int = 0
    """How many were judged since."""
    failed: bool = False
    """Whether it began anew because it failed."""


class Sight:
    """The account of one region's judged frames."""

    def __init__(self, config: SightConfig, outage_s: float) -> None:
        """After `outage_s` without a frame the region counts as starting, not as short of frames."""
        self._config = config
        self._outage_s = outage_s
        self._judged: deque[float] = deque(maxlen=config.least_frames)
        self._since_s: float | None = None
        self._run_s: float | None = None
        self._run = 0
        self._failed = False
        self.within_s = config.within_s
        """The time in which the frames must have been judged."""

    def ride(self, ride_s: float | None) -> None:
        """A lump crosses the region in so long (None: not known): the frames must come within that."""
        self.within_s = self._config.within_s if ride_s is None else min(ride_s, self._config.within_s)

    def begin(self, *, failed: bool = False) -> None:
        """The filter begins anew; with `failed` because it had to."""
        self._judged.clear()
        self._since_s = self._run_s = None
        self._run, self._failed = 0, failed or self._failed

    def judged(self, capture_s: float) -> None:
        """A frame was judged; times rise."""
        gap_s = capture_s - self._judged[-1] if self._judged else 0.0
        if self._since_s is None or gap_s > self._outage_s:
            self._since_s = capture_s
        if self._run_s is None or gap_s > self._config.longest_gap_s + _ROUNDING_S:
            self._run_s, self._run = capture_s, 0
        self._judged.append(capture_s)
        self._run += 1
        if self._failed and self.reason(capture_s) is None:
            self._failed = False

    def reason(self, now_s: float) -> BlindReason | None:
        """Why CLEAR cannot be said at `now_s`: FILTER after a failure, else FEW_FRAMES or STARTING; None: it can."""
        few = self._few(now_s)
        if not few and self._warmed_up():
            return None
        if self._failed:
            return BlindReason.FILTER
        lasted_s = 0.0 if self._since_s is None else now_s - self._since_s
        # Warming up takes as long as the frames take to come; only then are they too few.
        return BlindReason.FEW_FRAMES if few and lasted_s > self.within_s else BlindReason.STARTING

    def _few(self, now_s: float) -> bool:
        needed = self._config.least_frames
        return len(self._judged) < needed or now_s - self._judged[0] > self.within_s + _ROUNDING_S

    def _warmed_up(self) -> bool:
        if self._run_s is None or not self._judged:
            return False
        lasted_s = self._judged[-1] - self._run_s
        return self._run >= self._config.least_frames and lasted_s >= self._warm_up_s - _ROUNDING_S

    @property
    def _warm_up_s(self) -> float:
        return min(self._config.warm_up_s, self.within_s)

    def state(self) -> SightState:
        """All of it."""
        return SightState(tuple(self._judged), self._since_s, self._run_s, self._run, self._failed)

    def restore(self, state: SightState) -> None:
        """Go on from there."""
        self._judged.clear()
        self._judged.extend(state.judged_s)
        self._since_s, self._run_s = state.since_s, state.run_s
        self._run, self._failed = state.run, state.failed
