"""The hub's process: routes, cuts off who burdens it, and keeps to its memory.

It ends when the daemon asks it to, or when the daemon is gone; signals that reach every process of a service or a
terminal leave it alone, so that the last alarms still go out.
"""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import Bus, open_hub
from lumpwatch.service.config import BusConfig
from lumpwatch.service.core import log_to_stderr
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.hub import memory
from lumpwatch.service.protocol import COMMANDS
from lumpwatch.service.telemetry import DaemonConnection, HubMetrics, resident_bytes

log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.1
LISTEN_WITHIN_S = 2.0
"""A hub whose daemon was killed holds its ports until it has noticed that."""
_PAUSE_S = 0.1
_TELL_S = 5.0
_TRIM_EVERY_S = 10.0
_SLACK = 1.25
"""The system's own limit lies above ours, which ends the process with a line in the log."""


def run_hub(config: BusConfig, connection: Connection) -> None:
    """Be the hub until told to stop; the entry point of the process. All ports in `config.listen` are real ones."""
    memory.few_arenas()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    log_to_stderr()
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    metrics = HubMetrics(registry)
    try:
        bus = _listen(config, daemon)
    except LumpwatchError as error:
        log.error("%s", error)  # noqa: TRY400 - the line says it all
        daemon.problem = str(error)
        daemon.report_soon()
        daemon.wait(_TELL_S)
        daemon.close()
        os._exit(1)
    most = config.hub.memory_mib << 20
    memory.forbid_growth(int(_SLACK * most))
    daemon.state = "running"
    daemon.report_soon()
    look(bus, daemon, metrics, Allowance(most))
    if not daemon.orphaned:
        bus.close()
        daemon.close()
    os._exit(0)  # nothing is left to save, and frozen peers must not hold it up


def look(bus: Bus, daemon: DaemonConnection, metrics: HubMetrics, allowance: Allowance) -> None:
    """Cut off who burdens the hub, until told to stop; ends the process where it takes too much memory."""
    while not daemon.wait(LOOK_EVERY_S):
        metrics.cut_off(bus.cut_off())
        if (too_much := allowance.exceeded()) is not None:
            log.error("%s", too_much)
            os._exit(1)


class Allowance:
    """How much more memory the process may take than it had at first."""

    def __init__(
        self,
        most: int,
        resident: Callable[[], int] = resident_bytes,
        trim: Callable[[], None] = memory.give_back,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._most = most
        self._resident = resident
        self._trim = trim
        self._clock = clock
        self._first = resident()
        self._trimmed_s = clock()

    def exceeded(self) -> str | None:
        """What is to be said where it takes too much; gives back what is free before that is said, and now and then."""
        used, now = self._resident() - self._first, self._clock()
        if used > self._most or (used > self._most / 4 and now - self._trimmed_s > _TRIM_EVERY_S):
            self._trimmed_s = now
            self._trim()
            used = self._resident() - self._first
        if used <= self._most:
            return None
        return (
            f"bus: the hub has taken {used >> 20} MiB, more than bus.hub.memory_mib ({self._most >> 20}); "
            "it ends, and is started again"
        )


def _listen(config: BusConfig, daemon: DaemonConnection) -> Bus:
    """The hub; raises BusError where it cannot listen, ConfigError for a certificate that cannot be read."""
    deadline = time.monotonic() + LISTEN_WITHIN_S
    while True:
        try:
            return open_hub(config, COMMANDS.values())
        except LumpwatchError as error:
            if "in use" not in str(error) or time.monotonic() > deadline or daemon.wait(_PAUSE_S):
                raise
