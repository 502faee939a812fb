"""What every process that works on frames counts and times.

Base units; each label means one thing in all metrics. A worker process
fills a registry of its own, whose text travels to the daemon (see `relay`).
"""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Histogram

BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Seconds."""


class FrameMetrics:
    """Metrics that the camera's and the monitor's process both have: each its own stages and reasons."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        self._camera = camera
        self._dropped = Counter(
            "lumpwatch_frames_dropped",
            "Frames that were received but not processed, by reason.",
            ("camera", "reason"),
            registry=registry,
        )
        self._paced = Counter(
            "lumpwatch_frames_paced",
            "Frames that were not decided on by rule (decide_hz), which are not lost; roi is empty for frames that no "
            "region was due on.",
            ("camera", "roi"),
            registry=registry,
        )
        self._stage = Histogram(
            "lumpwatch_stage_duration_seconds",
            "Time that a stage of the work on one frame takes; roi is empty for stages of the whole frame.",
            ("camera", "roi", "stage"),
            buckets=BUCKETS,
            registry=registry,
        )

    def dropped(self, reason: str, count: int = 1) -> None:
        """Frames were not processed."""
        self._dropped.labels(self._camera, reason).inc(count)

    def paced(self, roi: str = "") -> None:
        """A frame was passed over by rule."""
        self._paced.labels(self._camera, roi).inc()

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """A stage took this long."""
        self._stage.labels(self._camera, roi, stage).observe(seconds)
