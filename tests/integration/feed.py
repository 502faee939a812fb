"""A camera of which the test decides what it sees."""

from __future__ import annotations

import threading
import time
from typing import Self

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.keys import Keys
from tests.service_helpers import HEIGHT, WIDTH, frame, picture


class Feed:
    """The camera: 20 frames a second, with the object while `bright`, the same again while `frozen`."""

    def __init__(self, bus: Bus, camera: str = "cam") -> None:
        self.bright = False
        self.frozen = False
        self.late_s = 0.0
        """How old the pictures are when they come."""
        self._publisher = bus.frame_publisher(Keys("test").frame(camera))
        self._pictures = {bright: picture(bright=bright) for bright in (False, True)}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def name(self) -> str:
        """What its frames call it, as anyone on the bus can read."""
        return self._publisher.name

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        seq, now = 0, 0.0
        while not self._stop.wait(0.05):
            if not self.frozen:
                seq, now = seq + 1, time.monotonic()
            one = frame(
                seq,
                time_s=now - self.late_s,
                received_s=now,
                data=self._pictures[self.bright],
                size=(WIDTH, HEIGHT),
            )
            self._publisher.publish(one, "raw", None)
