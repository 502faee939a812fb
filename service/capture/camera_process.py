"""The camera process: source -> frames on the bus."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from multiprocessing.connection import Connection

import numpy as np
from prometheus_client import CollectorRegistry

from lumpwatch.models.picture.reference import thumbnail
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.service.belt import camera_pace
from lumpwatch.service.bus import BusClosed, Keys, open_client
from lumpwatch.service.capture.proof_blender import Blender
from lumpwatch.service.capture.sources.base import Fault
from lumpwatch.service.capture.sources.make import make_source
from lumpwatch.service.capture.sources.reconnect import Reconnecting
from lumpwatch.service.config import CameraConfig, SiteConfig
from lumpwatch.service.core import Frame, Pace, log_to_stderr, reduced_frame
from lumpwatch.service.telemetry import CameraMetrics, DaemonConnection

log = logging.getLogger(__name__)


def run_camera(config: SiteConfig, camera_id: str, connection: Connection) -> None:
    """Read frames and publish them until told to stop; the entry point of the process."""
    log_to_stderr()
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    daemon.obey_signals()
    camera = config.camera(camera_id)
    metrics = CameraMetrics(registry, camera_id)
    keys = Keys(config.site)
    try:
        with open_client(config.bus, daemon.stop) as bus:
            publisher = bus.frame_publisher(
                keys.frame(camera_id), keys.jpeg(camera_id), camera.wire.jpeg_quality
            )
            blender = Blender(camera)
            tests = bus.frame_publisher(keys.test_frame(camera_id))
            bus.serve(keys.blend(camera_id), blender.request)
            bus.alive(keys.alive("camera", camera_id))
            source = Reconnecting(
                make_source(
                    camera.source,
                    camera_id,
                    "i420" if camera.needs_colour else "gray8",
                    count=metrics.dropped,
                    sleep=daemon.wait,
                ),
                camera.source.backoff,
                daemon.stop,
                _ConnectionReporter(metrics, daemon),
                np.random.default_rng(),  # jitter only: nothing that must be repeatable
                daemon.wait,
            )
            daemon.state = "connecting"
            reduce = Reducer(camera)
            while (frame := _read(source, daemon, metrics)) is not None:
                if not reduce.is_due(frame):
                    metrics.paced()
                    continue
                started = time.perf_counter()
                whole = frame if publisher.picture_wanted else None
                publisher.publish(reduce(frame), camera.wire.encoding, whole)
                metrics.stage("publish", "", time.perf_counter() - started)
                if (with_lump := blender.frame(frame)) is not None:
                    tests.publish(reduce(with_lump), camera.wire.encoding)
            if not daemon.stop.is_set():
                log.warning("camera %s: %s has ended", camera_id, camera.source.redacted)
                metrics.failed(Fault.ENDED)
                daemon.state = "ended"
                while not daemon.wait(60.0):
                    pass
            source.close()
    except BusClosed:
        pass  # told to stop before the hub was there
    finally:
        daemon.close()


def _read(source: Reconnecting, daemon: DaemonConnection, metrics: CameraMetrics) -> Frame | None:
    daemon.beat()
    frame = source.read()
    if frame is not None:
        metrics.received(frame.wall_s)
        metrics.stage("receive", "", max(0.0, time.monotonic() - frame.received_s))
    return frame


class Reducer:
    """Cuts frames down to what the camera's regions need, and tells which they need, whatever the size of the picture.

    Where the quality of the picture is checked, a thumbnail of the whole goes with it.
    """

    def __init__(self, camera: CameraConfig) -> None:
        self._camera = camera
        self._thumb: tuple[float, Image] | None = None
        self._size = (0, 0)
        self._rois: tuple[Roi, ...] = ()
        self._pace = Pace()

    def is_due(self, frame: Frame) -> bool:
        """Whether any region is to be decided on it."""
        self._fit(frame)
        return self._pace.take(frame.capture_s)

    def __call__(self, frame: Frame) -> Frame:
        """The reduced frame; the whole frame where a region does not fit the picture: the monitor says so."""
        self._fit(frame)
        if not self._rois:
            return frame
        cut = reduced_frame(frame, self._rois, self._camera.quality.follows * frame.width)
        return frame if cut is frame else replace(cut, thumb=self._thumbnail(frame))

    def _fit(self, frame: Frame) -> None:
        if (frame.width, frame.height) == self._size:
            return
        self._size, self._thumb = (frame.width, frame.height), None
        self._pace = camera_pace(self._camera, *self._size)
        try:
            self._rois = tuple(
                make_roi(roi.polygon, *self._size, roi.working_size_px) for roi in self._camera.rois
            )
        except ValueError:
            self._rois = ()

    def _thumbnail(self, frame: Frame) -> Image | None:
        """One that is not older than a check's distance: it is sent with every frame, for some are skipped."""
        quality = self._camera.quality
        if not (quality.enabled and quality.moved.enabled):
            return None
        last = self._thumb
        if last is None or not 0.0 <= frame.capture_s - last[0] < 1.0 / quality.rate_hz:
            self._thumb = last = frame.capture_s, thumbnail(frame.data)
        return last[1]


class _ConnectionReporter:
    """What happens to the connection, for metrics and the daemon."""

    def __init__(self, metrics: CameraMetrics, daemon: DaemonConnection) -> None:
        self._metrics = metrics
        self._daemon = daemon

    def attempt(self) -> None:
        self._metrics.attempt()
        self._daemon.state = "connecting"

    def connected(self) -> None:
        self._metrics.connected()
        self._daemon.state = "running"

    def failed(self, fault: Fault) -> None:
        self._metrics.failed(fault)
        self._daemon.state = "waiting"

    dropped = failed
