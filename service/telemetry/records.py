"""The metrics of what the monitor's process keeps: the event log, and the evidence of alarms."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge


class RecordMetrics:
    """One camera's; `MonitorMetrics` has them."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        self._camera = camera
        self._written = Counter(
            "lumpwatch_events_written", "Events that are in the event log.", ("camera",), registry=registry
        )
        self._event_problems = Counter(
            "lumpwatch_event_log_problems",
            "Trouble with the event log; reason is corrupt, unwritable, late (slow disk), lost, refused (set aside), "
            "removed or replaced (under the daemon) or failed.",
            ("camera", "reason"),
            registry=registry,
        )
        self._events_waiting = Gauge(
            "lumpwatch_events_waiting",
            "Events that are not on the disk yet.",
            ("camera",),
            registry=registry,
        )
        self._events_removed = Counter(
            "lumpwatch_events_removed",
            "Rows that the event log has forgotten after their time.",
            ("camera",),
            registry=registry,
        )
        self._evidence = Counter(
            "lumpwatch_evidence_written",
            "Clips with all that belongs to them.",
            ("camera", "roi"),
            registry=registry,
        )
        self._evidence_problems = Counter(
            "lumpwatch_evidence_problems",
            "Evidence that was not kept; reason is memory, unwritable or disk_full.",
            ("camera", "reason"),
            registry=registry,
        )
        self._evidence_removed = Counter(
            "lumpwatch_evidence_removed",
            "Evidence that was removed; reason is age or space.",
            ("camera", "reason"),
            registry=registry,
        )
        self._evidence_bytes = Gauge(
            "lumpwatch_evidence_stored_bytes",
            "Evidence of the camera on the disk.",
            ("camera",),
            registry=registry,
        )
        self._pre_roll = Gauge(
            "lumpwatch_evidence_pre_roll_seconds",
            "Pre-roll in memory for the next clip; below pre_roll_s where memory_mb is too small.",
            ("camera",),
            registry=registry,
        )
        self._written.labels(camera)
        self._events_waiting.labels(camera)
        self._events_removed.labels(camera)
        for roi in rois:
            self._evidence.labels(camera, roi)
        for reason in ("memory", "unwritable", "disk_full"):
            self._evidence_problems.labels(camera, reason)
        for reason in ("age", "space"):
            self._evidence_removed.labels(camera, reason)
        for reason in (
            "corrupt", "unwritable", "late", "lost", "refused", "removed", "replaced", "failed",
        ):  # fmt: skip
            self._event_problems.labels(camera, reason)

    def events_written(self, count: int) -> None:
        """Events are in the event log."""
        self._written.labels(self._camera).inc(count)

    def events_waiting(self, count: int) -> None:
        """Events are not on the disk yet."""
        self._events_waiting.labels(self._camera).set(count)

    def event_problem(self, reason: str, count: int = 1) -> None:
        """The event log is in trouble."""
        self._event_problems.labels(self._camera, reason).inc(count)

    def events_removed(self, count: int) -> None:
        """The event log has forgotten some."""
        self._events_removed.labels(self._camera).inc(count)

    def evidence_written(self, roi: str) -> None:
        """A clip is on the disk."""
        self._evidence.labels(self._camera, roi).inc()

    def evidence_problem(self, reason: str) -> None:
        """Evidence was not kept."""
        self._evidence_problems.labels(self._camera, reason).inc()

    def evidence_removed(self, reason: str, count: int) -> None:
        """Evidence had to go."""
        self._evidence_removed.labels(self._camera, reason).inc(count)

    def evidence_stored(self, size: int) -> None:
        """Evidence on the disk, bytes."""
        self._evidence_bytes.labels(self._camera).set(size)

    def pre_roll(self, seconds: float) -> None:
        """The pre-roll in memory for the next clip."""
        self._pre_roll.labels(self._camera).set(seconds)
