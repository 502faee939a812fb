"""The clock of a camera whose time stamps may count too fast or too slow, or may say nothing at all.

`StreamClock` finds when a camera's zero was, and trusts its seconds. Some cameras declare 25 frames a second and
deliver 21, some count in another unit or not at all. Arrivals tell: the straight line through the fastest arrivals of
every half second has the true length of a camera's second as its slope. The line is robust (Theil and Sen), so a
stall or a burst does not bend it. A rate within `MOST` is put right; stamps that contradict arrivals by more give way
to them.

A network that falls behind by a steady share looks like a slow clock. So a wrong rate is only believed of a camera in
the first `YOUNG_S` of a connection: later the delay shows as what it is, and a connection made anew is measured anew.
"""

from __future__ import annotations

from collections import deque
from itertools import combinations
from statistics import median
from typing import NamedTuple

from lumpwatch.service.core.media_time import Stamp, StreamClock

MOST = 1.5
"""A camera's second lasts between 1 / MOST and MOST seconds; else its stamps are not believed."""
LEAST = 0.01
"""Rates that differ by less from 1 count as 1: what the leak of `StreamClock` does not follow is small."""
YOUNG_S = 30.0
STANDING_S = 2.0
"""Stamps that stand still for so long while pictures come are not believed, or for less where nobody can wait."""
_BUCKET_S = 0.5
_LEAST_BUCKETS = 8
_TOLD_BUCKETS = 20
_MOST_BUCKETS = 60
_APART = 4
"""Buckets between two of which a slope is taken."""
_SCATTER = 0.2
"""The arrivals must lie so close to the line, as a share of how far it leads away from a right clock."""


class _Fast(NamedTuple):
    """The fastest arrival of half a second."""

    pts_s: float
    received_s: float


class CameraClock:
    """Capture times of a stream whose stamps may be wrong; see the module.

    Captures never lie after `received_s` and never go back.
    """

    def __init__(self, patience_s: float = STANDING_S) -> None:
        """`patience_s`: how long whoever reads the stream can wait while its stamps stand still."""
        self._standing_s = min(STANDING_S, patience_s)
        self._clock = StreamClock()
        self.second_s = 1.0
        """How long a second of the camera lasts."""
        self.by_arrival = False
        """Whether its stamps are not believed, and pictures count as captured when they arrive."""
        self.news: str | None = None
        """What was last found to be wrong, in words; whoever tells it sets it back to None."""
        self._told_s = 1.0
        self._buckets: deque[_Fast] = deque(maxlen=_MOST_BUCKETS)
        self._fastest: _Fast | None = None
        self._bucket_end_s = float("-inf")
        self._began_s: float | None = None
        self._seen: float | None = None
        self._pts: float | None = None
        self._true = 0.0
        self._stands_s: float | None = None

    def restart(self) -> None:
        """The next frame belongs to a new connection: measured anew, at the rate known so far until then."""
        self._clock.restart()
        self.by_arrival = False
        self._forget()

    def stamp(self, pts_s: float | None, received_s: float) -> Stamp:
        """Capture time of a frame with this time stamp, if it has one; `received_s` must not fall."""
        if pts_s is not None:
            self._observe(pts_s, received_s)
        if pts_s is None or self.by_arrival:
            return self._clock.stamp(None, received_s)
        if self._pts is None or pts_s < self._pts:  # the stream's own clock tells of jumps
            self._true = pts_s if self._pts is None else self._true - (self._pts - pts_s)
        else:
            self._true += (pts_s - self._pts) * self.second_s
        self._pts = pts_s
        return self._clock.stamp(self._true, received_s)

    def repeated(self, received_s: float) -> None:
        """A frame came with the stamp of the one before it."""
        if self._stands_s is None:
            self._stands_s = received_s
        elif received_s - self._stands_s >= self._standing_s and not self.by_arrival:
            self._distrust("its time stamps stand still")

    def _forget(self) -> None:
        self._buckets.clear()
        self._fastest, self._bucket_end_s = None, float("-inf")
        self._began_s = self._seen = self._pts = self._stands_s = None

    def _observe(self, pts_s: float, received_s: float) -> None:
        """Measure the rate with one more arrival."""
        self._stands_s = None
        if self._seen is not None and pts_s < self._seen:  # counted anew
            self._buckets.clear()
            self._fastest, self._bucket_end_s = None, float("-inf")
        self._seen = pts_s
        self._began_s = received_s if self._began_s is None else self._began_s
        if received_s >= self._bucket_end_s:
            if self._fastest is not None:
                self._buckets.append(self._fastest)
                self._judge(received_s)
                self._tell_rate()
            self._fastest, self._bucket_end_s = None, received_s + _BUCKET_S
        if self._fastest is None or received_s - pts_s < self._fastest.received_s - self._fastest.pts_s:
            self._fastest = _Fast(pts_s, received_s)

    def _judge(self, now_s: float) -> None:
        assert self._began_s is not None
        if self.by_arrival or len(self._buckets) < _LEAST_BUCKETS or now_s - self._began_s > YOUNG_S:
            return
        second_s = self._slope()
        if not 1 / MOST <= second_s <= MOST:
            self._distrust("its time stamps contradict the arrivals of its pictures")
            return
        if abs(second_s - 1.0) < LEAST:
            second_s = 1.0
        if abs(second_s - self.second_s) < LEAST / 2 or not self._straight(second_s):
            return
        self.second_s = second_s
        self._clock.restart()  # what it took for a delay was the rate

    def _tell_rate(self) -> None:
        """Once it is well known: what a connection begins with, such as a burst, bends the first seconds."""
        if len(self._buckets) < _TOLD_BUCKETS or abs(self.second_s - self._told_s) <= LEAST:
            return
        self._told_s = self.second_s
        share = round(abs(1 / self.second_s - 1.0) * 100)
        way = "slow" if self.second_s > 1.0 else "fast"
        self.news = f"its clock runs {share} % {way}" if share else "its clock runs right"

    def _slope(self) -> float:
        """Seconds that a second of the camera lasts."""
        slopes = [
            (b.received_s - a.received_s) / (b.pts_s - a.pts_s) if b.pts_s > a.pts_s else float("inf")
            for (i, a), (k, b) in combinations(enumerate(self._buckets), 2)
            if k - i >= _APART
        ]
        return median(slopes)

    def _straight(self, second_s: float) -> bool:
        """Whether the arrivals lie on the line: a delay that comes and goes does not."""
        off = [fast.received_s - second_s * fast.pts_s for fast in self._buckets]
        middle = median(off)
        scatter = median(abs(one - middle) for one in off)
        first, last = self._buckets[0], self._buckets[-1]
        return scatter <= _SCATTER * abs(second_s - self.second_s) * (last.pts_s - first.pts_s)

    def _distrust(self, why: str) -> None:
        self.by_arrival = True
        self.news = f"{why}; pictures count as captured when they arrive"
