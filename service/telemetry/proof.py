"""The metrics of the proof tests."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.protocol import Outcome, ProofResult


class ProofMetrics:
    """Those of one camera's ROIs."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        labels = ("camera", "roi")
        self._camera = camera
        self._ended = Counter(
            "lumpwatch_proof_tests",
            "Proof tests that ended; reason is passed, failed or inconclusive.",
            (*labels, "reason"),
            registry=registry,
        )
        self._passed = Gauge(
            "lumpwatch_proof_test_passed",
            "1 where the last proof test that could be judged passed, 0 where it failed; absent before the first.",
            labels,
            registry=registry,
        )
        self._warning = Gauge(
            "lumpwatch_proof_test_warning_seconds",
            "Seconds from the alarm of the last proof test until its lump was at the lip; 0: no alarm.",
            labels,
            registry=registry,
        )
        self._age = Gauge(
            "lumpwatch_proof_test_age_seconds",
            "Time since the last proof test that could be judged; absent before the first.",
            labels,
            registry=registry,
        )
        for roi in rois:
            for outcome in Outcome:
                self._ended.labels(camera, roi, outcome.value)

    def ended(self, roi: str, result: ProofResult) -> None:
        """A test ended."""
        self._ended.labels(self._camera, roi, result.outcome.value).inc()
        if result.outcome is not Outcome.INCONCLUSIVE:
            self.judged(roi, result)
            self.age(roi, 0.0)

    def judged(self, roi: str, result: ProofResult) -> None:
        """What the last test that could be judged showed."""
        self._passed.labels(self._camera, roi).set(result.outcome is Outcome.PASSED)
        self._warning.labels(self._camera, roi).set(result.warning_s or 0.0)

    def age(self, roi: str, age_s: float) -> None:
        """How long ago it was."""
        self._age.labels(self._camera, roi).set(age_s)
