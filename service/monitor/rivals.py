"""Others that use this camera's names on the bus: a copied configuration, a forgotten process, a forger.

A name is no identity: publishers have one of their own (see `lumpwatch.service.bus`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from lumpwatch.service.core import Trouble

log = logging.getLogger(__name__)

STANDS_S = 10.0
"""So long after its last sign a rival still counts."""

_WORDS = {
    Trouble.SECOND_SOURCE: "another process sends frames under this camera's name; they are refused",
    Trouble.SECOND_MONITOR: "another monitor announces under this camera's name",
}


class Rivals:
    """When others were last seen; `seen` may be called in any thread."""

    def __init__(self, camera: str, now: Callable[[], float]) -> None:
        self._camera = camera
        self._now = now
        self._seen_s: dict[Trouble, float] = {}
        self._foreign = 0
        self._told: frozenset[Trouble] = frozenset()

    def monitor(self, publisher: str) -> None:
        """A heartbeat of another publisher was heard."""
        del publisher
        self._seen_s[Trouble.SECOND_MONITOR] = self._now()

    def frames(self, refused: int) -> None:
        """So many frames of other publishers were refused so far."""
        if refused > self._foreign:
            self._seen_s[Trouble.SECOND_SOURCE] = self._now()
        self._foreign = refused

    def troubles(self) -> Mapping[Trouble, bool]:
        """Which there are now; new ones are logged."""
        now, seen = self._now(), dict(self._seen_s)
        found = {what: what in seen and now - seen[what] < STANDS_S for what in _WORDS}
        present = frozenset(what for what, there in found.items() if there)
        for what in sorted(present - self._told):
            log.error("%s: %s", self._camera, _WORDS[what])
        self._told = present
        return found
