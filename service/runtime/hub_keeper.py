"""Keeps the hub's process running, apart from the workers: they stop first, so that their last alarms go out."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from lumpwatch.service.bus import BusError, reachable, with_ports
from lumpwatch.service.config import BusConfig
from lumpwatch.service.hub import run_hub
from lumpwatch.service.runtime.supervisor import Start, Supervisor, Task, spawn
from lumpwatch.service.telemetry import STARTING, Relay, Report

HUB = "hub"
HUB_STUCK_S = 10.0
_START_WITHIN_S = 60.0
_LOOK_EVERY_S = 0.02


class HubKeeper:
    """The process of the hub, started anew where it ends; its addresses stay the same."""

    def __init__(
        self,
        config: BusConfig,
        relay: Relay,
        restarted: Callable[[str, str, str], None],
        start: Start = spawn,
    ) -> None:
        listen = with_ports(config.listen)
        self.endpoints = reachable(listen)
        """Where clients on this host reach it."""
        self._task = Task("", HUB, run_hub, (config.model_copy(update={"listen": listen}),), HUB_STUCK_S)
        self._supervisor = Supervisor([self._task], relay, restarted, start=start)

    def start(self, stop: threading.Event) -> None:
        """Returns when it listens, or when `stop` is set.

        Raises BusError where it cannot, ConfigError for a certificate that cannot be read.
        """
        deadline = time.monotonic() + _START_WITHIN_S
        while not stop.is_set():
            self.watch()
            report = self._report()
            if report is not None and report.problem:
                raise BusError(report.problem)
            if report is not None and report.state != STARTING:
                return
            if time.monotonic() > deadline:
                raise BusError(f"bus: the hub's process did not come up in {_START_WITHIN_S:.0f} s")
            stop.wait(_LOOK_EVERY_S)

    def watch(self) -> None:
        """Hear it, kill it where it is stuck, start it where it has ended; never waits."""
        self._supervisor.watch()

    def renew(self) -> None:
        """Start it anew, with the files as they are now; never waits."""
        self._supervisor.replace(self._task)

    def stop(self) -> tuple[str, ...]:
        """Stop it in bounded time; its name where it cannot be stopped."""
        return self._supervisor.stop()

    def _report(self) -> Report | None:
        return self._supervisor.reports().get((HUB, ""))
