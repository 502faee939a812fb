"""The metrics of priors that run in shadow."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.protocol import SIDES, Counts


class ShadowMetrics:
    """Metrics of the shadows of one camera; satisfies `lumpwatch.service.detection.shadow.shadows.ShadowObserver`."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        self._camera = camera
        labels = ("camera", "roi")
        self._version = Gauge(
            "lumpwatch_shadow_prior_version",
            "Version of the prior that runs in shadow; 0: none does.",
            labels,
            registry=registry,
        )
        self._existence = Gauge(
            "lumpwatch_shadow_existence_ratio",
            "Probability that a lump is there, by the prior in shadow.",
            labels,
            registry=registry,
        )
        self._seconds = Counter(
            "lumpwatch_shadow_agreement_seconds",
            "Time in which both decided; side is agree, or only_current or only_shadow: who alone had an alarm.",
            (*labels, "side"),
            registry=registry,
        )
        self._alarms = Counter(
            "lumpwatch_shadow_raised_alarms",
            "Alarms of the prior in use and of that in shadow; side is both, only_current or only_shadow.",
            (*labels, "side"),
            registry=registry,
        )
        self._frames = Counter(
            "lumpwatch_shadow_judged_frames",
            "Frames while a prior ran in shadow; outcome is looked (filtered), or skipped for want of time.",
            (*labels, "outcome"),
            registry=registry,
        )
        self._failures = Counter(
            "lumpwatch_shadow_failures",
            "Priors in shadow that ended; reason is failed, unfit or unreadable.",
            (*labels, "reason"),
            registry=registry,
        )
        for roi in rois:
            self._version.labels(camera, roi)
            for side in SIDES:
                self._alarms.labels(camera, roi, side)
            for reason in ("agree", "only_current", "only_shadow"):
                self._seconds.labels(camera, roi, reason)
            for reason in ("looked", "skipped"):
                self._frames.labels(camera, roi, reason)
            for reason in ("failed", "unfit", "unreadable"):
                self._failures.labels(camera, roi, reason)

    def shadow_counted(self, roi: str, before: Counts, after: Counts) -> None:
        """The counts of a ROI have changed."""
        changes = (
            (self._seconds, "agree", after.agree_s - before.agree_s),
            (self._seconds, "only_current", after.only_current_s - before.only_current_s),
            (self._seconds, "only_shadow", after.only_shadow_s - before.only_shadow_s),
            (self._alarms, "both", after.both - before.both),
            (self._alarms, "only_current", after.only_current - before.only_current),
            (self._alarms, "only_shadow", after.only_shadow - before.only_shadow),
            (self._frames, "looked", after.frames - before.frames),
            (self._frames, "skipped", after.skipped - before.skipped),
        )
        for counter, reason, amount in changes:
            if amount > 0:
                counter.labels(self._camera, roi, reason).inc(amount)

    def shadow_runs(self, roi: str, version: int) -> None:
        """Which version runs; 0: none does."""
        self._version.labels(self._camera, roi).set(version)

    def shadow_decided(self, roi: str, existence: float) -> None:
        """The probability of a lump by the shadow."""
        self._existence.labels(self._camera, roi).set(existence)

    def shadow_failed(self, roi: str, reason: str) -> None:
        """A shadow ended."""
        self._failures.labels(self._camera, roi, reason).inc()
