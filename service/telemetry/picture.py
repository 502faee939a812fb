"""Metrics of the picture's quality: what was measured, against which thresholds, and why a ROI is BLIND."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.core import BlindReason

if TYPE_CHECKING:  # the camera's process counts with this package, and needs no filter
    from lumpwatch.service.core import PictureQuality


class PictureMetrics:
    """One camera's; part of `MonitorMetrics`."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        self._camera = camera

        def gauge(name: str, text: str, *labels: str) -> Gauge:
            return Gauge(name, text, ("camera", *labels), registry=registry)

        def counter(name: str, text: str, *labels: str) -> Counter:
            return Counter(name, text, ("camera", *labels), registry=registry)

        self._reason = gauge(
            "lumpwatch_roi_blind_reason",
            "1 for the reason why the ROI cannot judge, 0 for all others.",
            "roi",
            "reason",
        )
        self._value = gauge(
            "lumpwatch_quality_value", "Median over seconds of each measure of the picture.", "roi", "measure"
        )
        self._threshold = gauge(
            "lumpwatch_quality_threshold",
            "Where the picture begins to be unfit: above it for saturated and strange, else below it.",
            "roi",
            "measure",
        )
        self._holdoffs = counter(
            "lumpwatch_exposure_holdoffs", "Hold-offs after the exposure had jumped.", "roi"
        )
        self._shift = gauge(
            "lumpwatch_camera_shift_pixels",
            "How far the camera has moved against its reference, full-frame pixels; 0 without one.",
        )
        self._follows = counter(
            "lumpwatch_camera_shifts_followed", "Small shifts of the camera that its ROIs followed."
        )
        self._reference = gauge(
            "lumpwatch_reference_version",
            "Version of the reference that the picture is judged by; 0: stated defaults.",
        )
        self._problems = counter(
            "lumpwatch_reference_problems", "References that were refused; reason is unreadable.", "reason"
        )
        self._counted: dict[str, int] = {}
        self._follows.labels(camera)
        self._problems.labels(camera, "unreadable")
        for roi in rois:
            self._holdoffs.labels(camera, roi)

    def update(self, roi: str, reason: BlindReason | None, quality: PictureQuality) -> None:
        """What is known of a ROI's picture, and why it is BLIND."""
        for candidate in BlindReason:
            self._reason.labels(self._camera, roi, candidate.value).set(candidate is reason)
        for measure, value in quality.values.items():
            self._value.labels(self._camera, roi, measure.value).set(value)
        for measure, value in quality.thresholds.items():
            self._threshold.labels(self._camera, roi, measure.value).set(value)
        self._holdoffs.labels(self._camera, roi).inc(self._newly(f"holdoffs {roi}", quality.holdoffs))

    def shifted(self, reference: int, shift_px: tuple[float, float] | None, follows: int) -> None:
        """The reference in use, and how far the camera has moved."""
        self._reference.labels(self._camera).set(reference)
        self._shift.labels(self._camera).set(math.hypot(*(shift_px or (0.0, 0.0))))
        self._follows.labels(self._camera).inc(self._newly("follows", follows))

    def refused(self, reason: str) -> None:
        """A reference cannot be read."""
        self._problems.labels(self._camera, reason).inc()

    def _newly(self, what: str, count: int) -> int:
        """How many of a running count were not counted yet."""
        before, self._counted[what] = self._counted.get(what, 0), count
        return max(count - before, 0)
