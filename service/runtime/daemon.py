"""The daemon: a process for the hub of the bus, one a camera, one a monitor; metrics and health.

    camera process --frames--> hub --frames--> monitor process --states, alarms--> hub

Camera and monitor share nothing but the bus. The daemon watches both kinds of process, kills the
stuck, starts the dead again, and judges its own health by whether every ROI has decided lately.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import BusClosed, Keys, open_client
from lumpwatch.service.capture import run_camera
from lumpwatch.service.config import BusConfig, CameraConfig, SiteConfig
from lumpwatch.service.monitor import run_monitor
from lumpwatch.service.runtime.config_file import changed_cameras
from lumpwatch.service.runtime.hub_keeper import HUB, HubKeeper
from lumpwatch.service.runtime.renewal import CertificateWatch
from lumpwatch.service.runtime.supervisor import Supervisor, Task
from lumpwatch.service.storage import lock_cameras
from lumpwatch.service.telemetry import DaemonMetrics, Relay, Report, TelemetryServer
from lumpwatch.service.threads import use_one_thread

log = logging.getLogger(__name__)

WATCH_EVERY_S = 0.1
MONITOR_STUCK_S = 10.0
_WATCH_LATE_S = 5.0


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where the running daemon can be reached."""

    bus: tuple[str, ...]
    telemetry: str


class Workers(Protocol):
    """The worker processes, as the daemon sees them; `Supervisor` is one."""

    def reports(self) -> Mapping[tuple[str, str], Report | None]:
        """The last report of each by role and camera; None: no report since its start."""

    def watch(self) -> None:
        """Hear all, kill the stuck, start the dead; never waits."""

    def stop(self) -> tuple[str, ...]:
        """Stop all in bounded time; gives those that cannot be stopped."""


class DaemonHealth:
    """Health as `/livez`, `/readyz` and `/startupz` report it."""

    def __init__(
        self, config: SiteConfig, workers: Workers, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._config = config
        self._workers = workers
        self._clock = clock
        self._started = False
        self._watched_s = clock()

    def follow(self, config: SiteConfig) -> None:
        """Judge the cameras by another configuration from now on."""
        kept = {camera.id for camera in self._config.cameras}
        cameras = tuple(camera for camera in config.cameras if camera.id in kept)
        self._config = config.model_copy(update={"cameras": cameras})

    def watched(self) -> None:
        """The daemon has just watched its workers."""
        self._watched_s = self._clock()

    def live(self) -> list[str]:
        """The watching loop turns."""
        late = self._clock() - self._watched_s
        return [f"workers were not watched for {late:.0f} s"] if late > _WATCH_LATE_S else []

    def ready(self) -> list[str]:
        """Every ROI has decided within its camera's `blind_after_s`."""
        return [
            problem
            for camera in self._config.cameras
            for roi in camera.rois
            if (problem := self._problem(camera, roi.id))
        ]

    def started(self) -> list[str]:
        """Every ROI has decided once since the start."""
        if not self._started:
            missing = self.ready()
            self._started = not missing
            return missing
        return []

    def _problem(self, camera: CameraConfig, roi: str) -> str | None:
        report = self._workers.reports().get(("monitor", camera.id))
        decided = report.decided.get(roi) if report is not None else None
        if decided is None:
            return f"{camera.id}/{roi}: has not decided yet"
        ago = self._clock() - decided
        return f"{camera.id}/{roi}: last decided {ago:.1f} s ago" if ago > camera.blind_after_s else None


def run(
    config: SiteConfig,
    stop: threading.Event,
    cameras: Sequence[str] = (),
    roles: Sequence[str] = ("camera", "monitor"),
    on_ready: Callable[[Addresses], None] = lambda _: None,
    changed: Callable[[], SiteConfig | None] = lambda: None,
) -> None:
    """Run until `stop` is set, then stop every process within some 5 s.

    Where one is left that even SIGKILL does not end, this process ends at once with code 1 instead: the
    interpreter would wait for its child for ever.

    `cameras` limits the daemon to some cameras and `roles` to one kind of process, for a fleet in
    which each runs elsewhere. `changed` gives a new configuration, once: cameras that differ in it are started
    anew, the others go on. Raises BusError and TelemetryError where an address cannot be used, and StoreError where
    another daemon watches one of the cameras with the same store.
    """
    use_one_thread()
    registry = CollectorRegistry()
    relay = Relay()
    registry.register(relay)
    metrics = DaemonMetrics(registry, version("lumpwatch"), config.store.path, _certificates(config.bus))
    chosen = [camera for camera in config.cameras if not cameras or camera.id in cameras]
    left: list[str] = []
    with (
        contextlib.suppress(BusClosed),
        contextlib.ExitStack() as stack,
    ):  # told to stop before there was a hub
        if "monitor" in roles:
            stack.enter_context(lock_cameras(config.store.path, [camera.id for camera in chosen]))
        hub: HubKeeper | None = None
        inner = config
        if config.bus.mode == "router":
            hub = HubKeeper(config.bus, relay, metrics.restarted)
            metrics.watched("", HUB)
            stack.callback(lambda: left.extend(hub.stop()))
            hub.start(stop)
            inner = config.model_copy(update={"bus": _as_client(config.bus, hub.endpoints)})
        bus = stack.enter_context(open_client(inner.bus, stop))
        tasks = [task for camera in chosen for task in tasks_of(inner, camera) if task.role in roles]
        for task in tasks:
            metrics.watched(task.camera, task.role)
        supervisor = Supervisor(tasks, relay, metrics.restarted)
        watched = config.model_copy(update={"cameras": tuple(chosen) if "monitor" in roles else ()})
        health = DaemonHealth(watched, supervisor)
        server = stack.enter_context(TelemetryServer(config.telemetry.address, registry, health))
        bus.alive(Keys(config.site).alive("daemon", config.site))
        stack.callback(lambda: left.extend(supervisor.stop()))
        on_ready(Addresses(bus.endpoints, server.url))

        present, certificates = config, CertificateWatch(config.bus.tls)

        def look() -> None:
            nonlocal present
            if hub is not None:
                hub.watch()
                if certificates.renewed():
                    hub.renew()
            if (after := changed()) is not None:
                present = _take_over(present, after, inner, supervisor, health, roles)

        watch(supervisor, health, stop, look)
        log.info("stopping")
    if left:
        logging.shutdown()
        os._exit(1)


def _take_over(
    before: SiteConfig,
    after: SiteConfig,
    inner: SiteConfig,
    supervisor: Supervisor,
    health: DaemonHealth,
    roles: Sequence[str],
) -> SiteConfig:
    """Start the cameras anew that differ; gives the configuration that holds from now on."""
    names = changed_cameras(before, after)
    if not names:
        return before
    now = before.model_copy(update={"cameras": after.cameras})
    for camera in now.cameras:
        if camera.id in names:
            log.info("camera %s: its configuration has changed; it is started anew", camera.id)
            for task in tasks_of(inner.model_copy(update={"cameras": after.cameras}), camera):
                if task.role in roles:
                    supervisor.replace(task)
    health.follow(now)
    return now


def watch(
    workers: Workers,
    health: DaemonHealth,
    stop: threading.Event,
    look: Callable[[], object] = lambda: None,
) -> None:
    """Watch the workers, and `look` at whatever else is watched, until `stop` is set."""
    while not stop.is_set():
        workers.watch()
        look()
        health.watched()
        stop.wait(WATCH_EVERY_S)


def _certificates(bus: BusConfig) -> dict[str, Path]:
    """The files of the bus whose end would end its links."""
    return {} if bus.tls is None else {"ca": bus.tls.ca, "certificate": bus.tls.certificate}


def _as_client(bus: BusConfig, endpoints: tuple[str, ...]) -> BusConfig:
    """How the daemon's own processes join: as clients of its hub."""
    return bus.model_copy(update={"mode": "client", "connect": endpoints, "listen": ()})


def tasks_of(config: SiteConfig, camera: CameraConfig) -> list[Task]:
    """The processes of one camera."""
    # A connection may use up both of its time-outs without a beat, and twice as FFmpeg counts.
    patience = 2 * camera.source.longest_silence_s + 5.0
    return [
        Task(camera.id, "monitor", run_monitor, (config, camera.id), MONITOR_STUCK_S),
        Task(camera.id, "camera", run_camera, (config, camera.id), patience),
    ]
