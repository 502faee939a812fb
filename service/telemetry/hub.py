"""The metrics of the hub's process."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from prometheus_client import CollectorRegistry, Counter

from lumpwatch.service.bus import Burden, CutOff
from lumpwatch.service.telemetry.process import ProcessMetrics

log = logging.getLogger(__name__)

_WHY = {
    Burden.SLOW: "did not read",
    Burden.LOUD: "sent more than a reader may, or was one too many (bus.hub)",
}


class HubMetrics:
    """Metrics of the hub."""

    def __init__(self, registry: CollectorRegistry) -> None:
        ProcessMetrics(registry, "", "hub")
        self._cut_off = Counter(
            "lumpwatch_bus_sessions_cut_off",
            "Sessions that the hub ended; reason slow: they did not read what waited for them, loud: they may only "
            "read or give commands and sent too much, or were too many.",
            ("reason",),
            registry=registry,
        )
        for burden in Burden:
            self._cut_off.labels(burden.value)

    def cut_off(self, sessions: Sequence[CutOff]) -> None:
        """These sessions were ended."""
        for session in sessions:
            self._cut_off.labels(session.burden.value).inc()
            who = f"{session.name}, {session.peer}" if session.name else session.peer
            log.warning("bus: the session from %s %s and was cut off", who, _WHY[session.burden])
