"""How long each ROI could see: sums over spans of a minute, for the event log.

The time between two looks at a ROI counts as what the first of them said. A longer gap means that the
monitor itself stood still: what goes beyond it belongs to no span, and no report takes it for seeing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lumpwatch.service.core import Clocks
from lumpwatch.service.storage import Span

SPAN_S = 60.0
LONGEST_LOOK_S = 2.0
"""A monitor that lives looks four times a second."""


@dataclass(slots=True)
class _Watched:
    begin_s: float
    """Monotonic clock, as all but the spans."""
    last_s: float
    said: str | None
    """Why it was blind; None: it could see."""
    seen_s: float = 0.0
    blind_s: dict[str, float] = field(default_factory=dict)


class WatchLog:
    """Sums up what the ROIs of one camera say."""

    def __init__(self) -> None:
        self._rois: dict[str, _Watched] = {}

    def saw(self, roi: str, reason: str | None, clocks: Clocks) -> tuple[Span, ...]:
        """A ROI said whether it sees; the spans that are complete by now."""
        now = clocks.monotonic_s
        watched = self._rois.setdefault(roi, _Watched(now, now, reason))
        ended = self._count(roi, watched, clocks)
        watched.said = reason
        if now - watched.begin_s < SPAN_S:
            return ended
        return (*ended, *self._end(roi, watched, clocks))

    def close(self, clocks: Clocks) -> tuple[Span, ...]:
        """All that is not told yet."""
        return tuple(
            span
            for roi, watched in self._rois.items()
            for span in (*self._count(roi, watched, clocks), *self._end(roi, watched, clocks))
        )

    def _count(self, roi: str, watched: _Watched, clocks: Clocks) -> tuple[Span, ...]:
        """Add the time since the last look; after a gap the span before it is complete."""
        passed = clocks.monotonic_s - watched.last_s
        counted = min(passed, LONGEST_LOOK_S)
        if watched.said is None:
            watched.seen_s += counted
        else:
            watched.blind_s[watched.said] = watched.blind_s.get(watched.said, 0.0) + counted
        watched.last_s += counted
        if passed == counted:
            return ()
        beyond = passed - counted
        ended = self._end(roi, watched, Clocks(watched.last_s, clocks.wall_s - beyond))
        watched.begin_s = watched.last_s = clocks.monotonic_s
        return ended

    def _end(self, roi: str, watched: _Watched, clocks: Clocks) -> tuple[Span, ...]:
        lasted = clocks.monotonic_s - watched.begin_s
        if lasted <= 0.0:
            return ()
        blind = {reason: round(time_s, 3) for reason, time_s in sorted(watched.blind_s.items())}
        span = Span(
            round(clocks.wall_s - lasted, 3), round(clocks.wall_s, 3), roi, round(watched.seen_s, 3), blind
        )
        watched.begin_s, watched.seen_s, watched.blind_s = clocks.monotonic_s, 0.0, {}
        return (span,)
