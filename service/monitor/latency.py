"""How long the way from capture to publication takes, and whether it eats up its budget."""

from __future__ import annotations

from lumpwatch.service.config import LatencyConfig
from lumpwatch.service.core import RoiResult
from lumpwatch.service.protocol import Latency


class LatencyTracker:
    """The latency of one ROI; times are seconds on the monitor's monotonic clock."""

    def __init__(self, config: LatencyConfig) -> None:
        self._config = config
        self._over_since_s: float | None = None
        self._publish_s = 0.0
        self.last: Latency | None = None
        """Of the last frame that was decided."""

    def decided(self, result: RoiResult, now_s: float) -> None:
        """A frame was decided at `now_s`."""
        frame, taken_s = result.frame, result.taken_s
        if frame is None or taken_s is None:
            return
        total_s = now_s - frame.capture_s + self._publish_s
        self.last = Latency(
            receive_s=round(frame.received_s - frame.capture_s, 6),
            bus_s=round(taken_s - frame.received_s, 6),
            decision_s=round(now_s - taken_s, 6),
            publish_s=round(self._publish_s, 6),
            total_s=round(total_s, 6),
            budget_s=self._config.budget_s,
        )
        if total_s <= self._config.budget_s:
            self._over_since_s = None
        elif self._over_since_s is None:
            self._over_since_s = now_s

    def published(self, seconds: float) -> None:
        """Bringing that result onto the bus took so long."""
        self._publish_s = seconds

    def exhausted(self, now_s: float) -> bool:
        """Whether every decision of the last `for_s` seconds came too late."""
        return self._over_since_s is not None and now_s - self._over_since_s >= self._config.for_s
