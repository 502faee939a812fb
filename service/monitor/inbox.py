"""Frames as they reach the monitor: the newest one, on this host's clock, and a count of those that are lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from lumpwatch.service.bus import FrameInbox
from lumpwatch.service.core import Frame, StreamClock


class Dropped(Protocol):
    """Counts frames that were not processed."""

    def __call__(self, reason: str, count: int = 1) -> None:
        """So many more."""


class Inbox:
    """The frames of one camera process, of this host or of another."""

    def __init__(self, frames: FrameInbox, dropped: Dropped, now: Callable[[], float]) -> None:
        """`now` reads this host's monotonic clock, in seconds."""
        self._frames = frames
        self._dropped = dropped
        self._now = now
        self._far_clock = StreamClock()
        self._counted: dict[str, int] = {}

    @property
    def foreign(self) -> int:
        """Frames of other publishers of the key, refused so far."""
        return self._frames.foreign

    def take(self, timeout_s: float) -> Frame | None:
        """The newest frame that was not taken yet; None after `timeout_s`."""
        frame = self._frames.take(timeout_s)
        if frame is None or self._frames.same_clock:
            return frame
        return on_this_clock(frame, self._far_clock, self._now())

    def count_losses(self) -> None:
        """Count what is new of the frames that newer ones replaced, and of malformed messages, by reason."""
        counts = {"skipped": self._frames.skipped, "second_source": self._frames.foreign}
        counts |= {f"malformed_{reason}": count for reason, count in dict(self._frames.malformed).items()}
        for reason, count in counts.items():
            if (new := count - self._counted.get(reason, 0)) > 0:
                self._dropped(reason, new)
                self._counted[reason] = count


def on_this_clock(frame: Frame, clock: StreamClock, arrived_s: float) -> Frame:
    """A frame of another host, with its times on this one's clock; `clock` is kept from frame to frame."""
    received = clock.stamp(frame.received_s, arrived_s).capture_s
    return replace(frame, received_s=received, capture_s=received - (frame.received_s - frame.capture_s))
