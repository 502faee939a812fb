"""At which moment a frame of a file is handed out, and which times it carries."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Times(NamedTuple):
    """The three times of a frame, as in `lumpwatch.service.core.frame.Frame`."""

    capture_s: float
    received_s: float
    wall_s: float


class Pacer:
    """Plays media time against the clocks.

    Paced: waits until a frame is due; a reader that falls behind by more than `max_late_s` makes
    the rest play later (`slipped`), since a file, unlike a camera, can wait. Not paced: never
    waits, and capture and received time are both the media time after the start, so that they do
    not depend on the speed of the machine.
    """

    def __init__(
        self,
        *,
        pace: bool,
        max_late_s: float,
        monotonic: Callable[[], float],
        wall: Callable[[], float],
        sleep: Callable[[float], object],
        slipped: Callable[[], None],
    ) -> None:
        self._pace = pace
        self._max_late_s = max_late_s
        self._monotonic = monotonic
        self._wall = wall
        self._sleep = sleep
        self._slipped = slipped
        self._start: float | None = None
        self._wall_start = 0.0
        self._capture = float("-inf")

    def restart(self) -> None:
        """The next frame is the first of a newly opened file; captures go on rising."""
        self._start = None

    def wait(self, media_s: float) -> Times:
        """Wait until the frame at `media_s` is due; its times."""
        if self._start is None:
            # Without pacing the captures of an earlier run may lie ahead of the clock.
            self._start = max(self._monotonic(), self._capture) - media_s
            self._wall_start = self._wall() - media_s
        due = self._start + media_s
        if not self._pace:
            self._capture = due
            return Times(due, due, self._wall_start + media_s)
        if (early := due - self._monotonic()) > 0:
            self._sleep(early)
        received = self._monotonic()
        if received - due > self._max_late_s:
            self._start += received - due
            due = received
            self._slipped()
        self._capture = min(due, received)
        return Times(self._capture, received, self._wall())
