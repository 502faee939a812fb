"""The uptime of each ROI, which is how long it could see: sums over spans of a minute, for the event log.

The time between two results of a ROI counts as the first of them was. A longer gap means that the
monitor itself stood still: what goes beyond it belongs to no span, and no report takes it for seeing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lumpwatch.service.core import Clocks
from lumpwatch.service.storage import Span

SPAN_S = 60.0
LONGEST_GAP_S = 2.0
"""A monitor that runs polls four times a second."""


@dataclass(slots=True)
class _OpenSpan:
    begin_s: float
    """Monotonic clock, as all but the spans."""
    last_s: float
    reason: str | None
    """Why it was blind; None: it could see."""
    seen_s: float = 0.0
    blind_s: dict[str, float] = field(default_factory=dict)


class UptimeRecorder:
    """Sums up how long the ROIs of one camera could see."""

    def __init__(self) -> None:
        self._rois: dict[str, _OpenSpan] = {}

    def observe(self, roi: str, reason: str | None, clocks: Clocks) -> tuple[Span, ...]:
        """A ROI could see (None), or was blind for this reason; the spans that are complete by now."""
        now = clocks.monotonic_s
        open_span = self._rois.setdefault(roi, _OpenSpan(now, now, reason))
        ended = self._count(roi, open_span, clocks)
        open_span.reason = reason
        if now - open_span.begin_s < SPAN_S:
            return ended
        return (*ended, *self._end(roi, open_span, clocks))

    def close(self, clocks: Clocks) -> tuple[Span, ...]:
        """All that is not returned yet."""
        return tuple(
            span
            for roi, open_span in self._rois.items()
            for span in (*self._count(roi, open_span, clocks), *self._end(roi, open_span, clocks))
        )

    def _count(self, roi: str, open_span: _OpenSpan, clocks: Clocks) -> tuple[Span, ...]:
        """Add the time since the last result; after a gap the span before it is complete."""
        passed_s = clocks.monotonic_s - open_span.last_s
        counted_s = min(passed_s, LONGEST_GAP_S)
        if open_span.reason is None:
            open_span.seen_s += counted_s
        else:
            open_span.blind_s[open_span.reason] = open_span.blind_s.get(open_span.reason, 0.0) + counted_s
        open_span.last_s += counted_s
        if passed_s == counted_s:
            return ()
        beyond_s = passed_s - counted_s
        ended = self._end(roi, open_span, Clocks(open_span.last_s, clocks.wall_s - beyond_s))
        open_span.begin_s = open_span.last_s = clocks.monotonic_s
        return ended

    def _end(self, roi: str, open_span: _OpenSpan, clocks: Clocks) -> tuple[Span, ...]:
        length_s = clocks.monotonic_s - open_span.begin_s
        if length_s <= 0.0:
            return ()
        blind = {reason: round(time_s, 3) for reason, time_s in sorted(open_span.blind_s.items())}
        span = Span(
            round(clocks.wall_s - length_s, 3),
            round(clocks.wall_s, 3),
            roi,
            round(open_span.seen_s, 3),
            blind,
        )
        open_span.begin_s, open_span.seen_s, open_span.blind_s = clocks.monotonic_s, 0.0, {}
        return (span,)
