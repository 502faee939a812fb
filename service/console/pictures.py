"""The newest picture of each camera that somebody watches, with what was decided of that very frame.

A camera encodes pictures only while someone listens. Here one thread a watched camera listens, and ends a few
seconds after the last viewer asked. Every viewer gets the same bytes; who is slow misses frames.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lumpwatch.service.bus import Bus, BusClosed, Keys
from lumpwatch.service.console.board import Board

IDLE_S = 5.0
"""How long after the last viewer a camera is still listened to."""
_KEPT = 25
_STALE_S = 1.5


@dataclass(frozen=True, slots=True)
class Picture:
    """A JPEG picture."""

    frame: int
    width: int
    height: int
    jpeg: bytes
    came_s: float


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture with the state of each region on that frame; none where the frame was not decided."""

    picture: Picture
    states: dict[str, dict[str, Any]]


class Pictures:
    """The pictures of a site's cameras."""

    def __init__(self, bus: Bus, board: Board, clock: Callable[[], float] = time.monotonic) -> None:
        self._bus = bus
        self._board = board
        self._clock = clock
        self._keys = Keys(board.config.site)
        self._lock = threading.Lock()
        self._asked: dict[str, float] = {}
        self._kept: dict[str, deque[Picture]] = {}
        self._cache: dict[str, Shown] = {}

    @property
    def watched(self) -> list[str]:
        """The cameras that are listened to."""
        with self._lock:
            return sorted(self._asked)

    def newest(self, camera: str, after: int) -> Shown | None:
        """The newest picture with its decisions, unless it is frame `after`; None while there is none."""
        self._want(camera)
        with self._lock:
            kept = list(self._kept.get(camera, ()))
        if not kept:
            return None
        decided = self._board.decided_on(camera)
        now = self._clock()
        picture = next((one for one in reversed(kept) if one.frame in decided), None)
        if picture is None or now - picture.came_s > _STALE_S:
            # Nothing has been decided for a while: the picture alone, which says so by having no state.
            picture = kept[-1]
        if picture.frame == after or now - picture.came_s > _STALE_S:
            return None
        with self._lock:
            cached = self._cache.get(camera)
        states = decided.get(picture.frame, {})
        if cached is None or cached.picture is not picture or len(cached.states) != len(states):
            cached = Shown(picture, {roi: json.loads(payload) for roi, payload in states.items()})
            with self._lock:
                self._cache[camera] = cached
        return cached

    def _want(self, camera: str) -> None:
        with self._lock:
            begins = camera not in self._asked
            self._asked[camera] = self._clock()
            if begins:
                self._kept[camera] = deque(maxlen=_KEPT)
                threading.Thread(
                    target=self._listen,
                    args=(camera, self._kept[camera]),
                    name=f"pictures {camera}",
                    daemon=True,
                ).start()

    def _listen(self, camera: str, kept: deque[Picture]) -> None:
        try:
            with contextlib.closing(self._bus.frame_inbox(self._keys.jpeg(camera))) as inbox:
                while self._wanted(camera):
                    if (taken := inbox.take_jpeg(0.5)) is not None:
                        kept.append(
                            Picture(taken.frame, taken.width, taken.height, taken.jpeg, self._clock())
                        )
        except BusClosed:
            pass
        with self._lock:
            if self._kept.get(camera) is kept:  # else another thread listens already
                for table in (self._asked, self._kept, self._cache):
                    table.pop(camera, None)

    def _wanted(self, camera: str) -> bool:
        with self._lock:
            asked = self._asked.get(camera)
            if asked is not None and self._clock() - asked <= IDLE_S:
                return True
            self._asked.pop(camera, None)
            return False
