"""When was the picture taken? Presentation time stamps against a clock of ours; pure arithmetic.

A live camera counts on a clock of its own whose zero and exact rate we do not know. Delay on the way
is never negative, so the frame with the smallest `received - pts` was the fastest so far, and that
minimum is the best anchor: capture = anchor + pts. It can only make captures early enough, never
later than received. A pure minimum would hold for ever on to a camera clock that runs slow, and
call its frames ever older; so the anchor leaks upwards by a small share of the time that passes.
The leak bounds what is tracked: a camera slow by less than `leak` never goes stale, and a standing
delay is forgotten at the same rate.
"""

from __future__ import annotations

from typing import NamedTuple

LEAK = 0.002
"""Seconds by which the anchor rises per second: ten times the worst crystal, two times 29.97 for 30."""
JUMP_S = 1.0
"""A time stamp further ahead of its arrival than this is a jump of the camera's clock."""


class Stamp(NamedTuple):
    """Capture time of a frame, and whether the time stamps have jumped to get there."""

    capture_s: float
    jumped: bool


class StreamClock:
    """Anchors the time stamps of a live stream to the monotonic clock.

    Captures never lie after `received_s` and never go back, over restarts and jumps as well.
    """

    def __init__(self, leak: float = LEAK, jump_s: float = JUMP_S) -> None:
        self._leak = leak
        self._jump_s = jump_s
        self._anchor: float | None = None
        self._pts = 0.0
        self._received = 0.0
        self._capture = float("-inf")

    def restart(self) -> None:
        """Forget the anchor: the next frame belongs to a new connection."""
        self._anchor = None

    def stamp(self, pts_s: float | None, received_s: float) -> Stamp:
        """Capture time of a frame with this time stamp, if it has one; `received_s` must not fall."""
        capture, jumped = received_s, False
        if pts_s is not None:
            fresh = received_s - pts_s
            if self._anchor is None:
                self._anchor = fresh
            elif pts_s < self._pts:
                self._anchor, jumped = fresh, True
            else:
                leaked = self._anchor + self._leak * (received_s - self._received)
                jumped = leaked - fresh > self._jump_s
                self._anchor = min(leaked, fresh)
            # anchor + pts may round to just above received
            capture = min(self._anchor + pts_s, received_s)
            self._pts, self._received = pts_s, received_s
        self._capture = max(capture, self._capture)
        return Stamp(self._capture, jumped)


class MediaClock:
    """Seconds since the first frame of a file, always rising: over laps, jumps and missing stamps.

    A frame that would not come later than the one before it comes one nominal interval after it.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._offset: float | None = None
        self._last: float | None = None

    def lap(self) -> None:
        """The next frame is the first one again."""
        self._offset = None

    def stamp(self, pts_s: float | None) -> Stamp:
        """Media time of the next frame (None: it has no time stamp of its own)."""
        following = 0.0 if self._last is None else self._last + self._interval_s
        media, jumped = following, False
        if pts_s is not None:
            if self._offset is None:
                self._offset = following - pts_s
            elif self._last is not None and pts_s + self._offset <= self._last:
                self._offset, jumped = following - pts_s, True
            else:
                media = pts_s + self._offset
        self._last = media
        return Stamp(media, jumped)
