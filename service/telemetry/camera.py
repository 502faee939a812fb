"""The metrics of the process that reads one camera."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.telemetry.frames import FrameMetrics
from lumpwatch.service.telemetry.process import ProcessMetrics


class CameraMetrics(FrameMetrics):
    """Metrics of the process that reads one camera."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        super().__init__(registry, camera)
        ProcessMetrics(registry, camera, "camera")
        self._received = Counter(
            "lumpwatch_frames_received",
            "Frames that the source delivered.",
            ("camera",),
            registry=registry,
        )
        self._attempts = Counter(
            "lumpwatch_source_connect_attempts",
            "Attempts to open the source.",
            ("camera",),
            registry=registry,
        )
        self._failures = Counter(
            "lumpwatch_source_failures",
            "Faults that ended a connection or an attempt to make one.",
            ("camera", "reason"),
            registry=registry,
        )
        self._connected = Gauge(
            "lumpwatch_source_connected",
            "1 while the source delivers frames.",
            ("camera",),
            registry=registry,
        )
        self._last = Gauge(
            "lumpwatch_last_frame_timestamp_seconds",
            "Wall-clock time at which the last frame was received.",
            ("camera",),
            registry=registry,
        )
        # A series that exists from the start lets `rate` see the first event.
        self._received.labels(camera)
        self._paced.labels(camera, "")
        self._attempts.labels(camera)
        self._connected.labels(camera).set(0)

    def received(self, wall_s: float) -> None:
        """A frame came from the source."""
        self._received.labels(self._camera).inc()
        self._last.labels(self._camera).set(wall_s)

    def attempt(self) -> None:
        """The source is being opened."""
        self._attempts.labels(self._camera).inc()

    def connected(self) -> None:
        """The source has delivered a frame."""
        self._connected.labels(self._camera).set(1)

    def failed(self, fault: str) -> None:
        """A connection ended, or could not be made."""
        self._failures.labels(self._camera, fault).inc()
        self._connected.labels(self._camera).set(0)
