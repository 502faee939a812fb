"""The metrics of the proof tests."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.protocol import Outcome, ProofReason, ProofResult

_WHY_FAILED = (
    ProofReason.NOT_DETECTED,
    ProofReason.TOO_LATE,
    ProofReason.NO_CAMERA,
    ProofReason.NO_FRAMES,
    ProofReason.ERROR,
)


class ProofMetrics:
    """Those of one camera's ROIs."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        labels = ("camera", "roi")
        self._camera = camera
        self._ended = Counter(
            "lumpwatch_proof_test_outcomes",
            "Proof tests that ended; outcome is passed, failed or inconclusive.",
            (*labels, "outcome"),
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
        self._time = Gauge(
            "lumpwatch_proof_test_timestamp_seconds",
            "When the last proof test that could be judged ended; absent before the first.",
            labels,
            registry=registry,
        )
        self._reason = Gauge(
            "lumpwatch_proof_test_reason",
            "1 for the reason why the last proof test that could be judged failed, 0 for all others.",
            (*labels, "reason"),
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

    def judged(self, roi: str, result: ProofResult) -> None:
        """What the last test that could be judged showed."""
        self._passed.labels(self._camera, roi).set(result.outcome is Outcome.PASSED)
        self._warning.labels(self._camera, roi).set(result.warning_s or 0.0)
        self._time.labels(self._camera, roi).set(result.time.timestamp())
        for reason in _WHY_FAILED:
            self._reason.labels(self._camera, roi, reason.value).set(reason is result.reason)
