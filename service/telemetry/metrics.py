"""The metrics of each process.

Base units; labels are camera, roi, class, stage, reason, measure and model only. A worker process fills a
registry of its own, whose text travels to the daemon (see `relay`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from lumpwatch.service.core import Alarm, AlarmClass, Change, Decision, Detection, Transition
from lumpwatch.service.protocol import Latency
from lumpwatch.service.telemetry.picture import PictureMetrics
from lumpwatch.service.telemetry.shadow import ShadowMetrics

_BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


class _FrameMetrics:
    """What the camera's and the monitor's process both count: each its own stages and reasons."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        self._camera = camera
        self._dropped = Counter(
            "lumpwatch_frames_dropped",
            "Frames that were received but not processed, by reason.",
            ("camera", "reason"),
            registry=registry,
        )
        self._stage = Histogram(
            "lumpwatch_stage_duration_seconds",
            "Time that a stage of the work on one frame takes; roi is empty for stages of the whole frame.",
            ("camera", "roi", "stage"),
            buckets=_BUCKETS,
            registry=registry,
        )

    def dropped(self, reason: str, count: int = 1) -> None:
        """Frames were not processed."""
        self._dropped.labels(self._camera, reason).inc(count)

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """A stage took this long."""
        self._stage.labels(self._camera, roi, stage).observe(seconds)


class CameraMetrics(_FrameMetrics):
    """Metrics of the process that reads one camera."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        super().__init__(registry, camera)
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


class MonitorMetrics(_FrameMetrics):
    """Metrics of the process that filters one camera's ROIs."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        super().__init__(registry, camera)
        self.shadows = ShadowMetrics(registry, camera, rois)
        labels = ("camera", "roi")

        def gauge(name: str, text: str) -> Gauge:
            return Gauge(name, text, labels, registry=registry)

        self._processed = Counter(
            "lumpwatch_frames_processed", "Frames that a ROI decided on.", labels, registry=registry
        )
        self._latency = Histogram(
            "lumpwatch_frame_to_decision_seconds",
            "Time from the decoded frame in the camera's process to the decision.",
            labels,
            buckets=_BUCKETS,
            registry=registry,
        )
        self._existence = gauge("lumpwatch_existence_ratio", "Probability that a lump is there.")
        of_alarm = (*labels, "class")

        def alarm_gauge(name: str, text: str) -> Gauge:
            return Gauge(name, text, of_alarm, registry=registry)

        self._active = alarm_gauge(
            "lumpwatch_alarm_active", "1 while the alarm condition holds, announced or not."
        )
        self._unacknowledged = alarm_gauge(
            "lumpwatch_alarm_unacknowledged", "1 while an alarm waits for acknowledgement."
        )
        self._shelved = alarm_gauge("lumpwatch_alarm_shelved", "1 while an operator has it shelved.")
        self._suppressed = alarm_gauge(
            "lumpwatch_alarm_suppressed", "1 while a plant signal suppresses the alarm."
        )
        self._out = alarm_gauge("lumpwatch_alarm_out_of_service", "1 while the alarm is out of service.")
        self._blind = gauge("lumpwatch_roi_blind", "1 while the ROI cannot judge.")
        self._transitions = Counter(
            "lumpwatch_alarm_transitions",
            "Changes of the alarm; reason is the change, such as raised, cleared or acknowledged.",
            (*of_alarm, "reason"),
            registry=registry,
        )
        self._refused = Counter(
            "lumpwatch_requests_refused",
            "Queries and puts that asked for what is not allowed; reason is the key's last part.",
            (*labels, "reason"),
            registry=registry,
        )
        self._written = Counter(
            "lumpwatch_events_written", "Events that are in the event log.", ("camera",), registry=registry
        )
        self._event_problems = Counter(
            "lumpwatch_event_log_problems",
            "Trouble with the event log; reason is corrupt, unwritable, late (slow disk) or lost.",
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
            "lumpwatch_evidence_written", "Clips with all that belongs to them.", labels, registry=registry
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
            "How much lies in memory for the next clip; below pre_roll_s where memory_mb is too small.",
            ("camera",),
            registry=registry,
        )
        self._effective = gauge("lumpwatch_effective_particles", "Effective number of particles.")
        self._fallback = gauge(
            "lumpwatch_switching_fallback_ratio",
            "Share of particles far from all training data, for which switching fell back on the matrix.",
        )
        self._prior = gauge("lumpwatch_prior_version", "Version of the prior in use; 0: stated defaults.")
        self._age = gauge("lumpwatch_prior_age_seconds", "Age of the prior in use.")
        self._problems = Counter(
            "lumpwatch_prior_problems",
            "Priors that were refused; reason is unreadable or unfit.",
            (*labels, "reason"),
            registry=registry,
        )
        self._objects = gauge("lumpwatch_objects", "Objects that are more likely there than not.")
        self._shares = Gauge(
            "lumpwatch_model_share_ratio",
            "Probability of each motion model, the mean over the objects that are there.",
            (*labels, "model"),
            registry=registry,
        )
        self._wrong_way = Counter(
            "lumpwatch_wrong_way_objects",
            "Objects that were flagged for moving against the configured direction.",
            labels,
            registry=registry,
        )
        self._oversize = gauge(
            "lumpwatch_oversize_ratio",
            "Probability that a lump above the limit is there; on calibrated belts, and what the alarm judges.",
        )
        self._largest = gauge(
            "lumpwatch_largest_mm", "Longest diameter of the largest lump; 0: none is known."
        )
        self._lip = gauge(
            "lumpwatch_lip_seconds", "Seconds until the first lump reaches the lip; +Inf: none is on its way."
        )
        self._budget = gauge(
            "lumpwatch_latency_budget_ratio",
            "Share of the latency budget that the last decision took, from capture to publication.",
        )
        self.picture = PictureMetrics(registry, camera, rois)
        self._flagged: dict[str, frozenset[int]] = {}
        for roi in rois:
            self._wrong_way.labels(camera, roi)
            self._processed.labels(camera, roi)
            self._blind.labels(camera, roi).set(1)
            for request in ("ack", "reset", "shelve", "unshelve", "service", "suppress", "verdict"):
                self._refused.labels(camera, roi, request)
            for alarm_class in AlarmClass:
                for change in Change:
                    self._transitions.labels(camera, roi, alarm_class.value, change.value)
        self._written.labels(camera)
        self._events_waiting.labels(camera)
        self._events_removed.labels(camera)
        for roi in rois:
            self._evidence.labels(camera, roi)
        for reason in ("memory", "unwritable", "disk_full"):
            self._evidence_problems.labels(camera, reason)
        for reason in ("age", "space"):
            self._evidence_removed.labels(camera, reason)
        for reason in ("corrupt", "unwritable", "late", "lost"):
            self._event_problems.labels(camera, reason)

    def decided(self, roi: str, latency_s: float, detection: Detection) -> None:
        """A ROI has decided on a frame."""
        self._processed.labels(self._camera, roi).inc()
        self._latency.labels(self._camera, roi).observe(latency_s)
        self._effective.labels(self._camera, roi).set(detection.effective_particles)
        self._fallback.labels(self._camera, roi).set(detection.fell_back_share)
        self._tell_objects(roi, detection)

    def latency(self, roi: str, latency: Latency) -> None:
        """What the way of the last decided frame took; the pipeline itself times cut and filter."""
        self._budget.labels(self._camera, roi).set(latency.total_s / latency.budget_s)
        self.stage("bus", roi, latency.bus_s)
        self.stage("announce", roi, latency.publish_s)

    def _tell_objects(self, roi: str, detection: Detection) -> None:
        objects = detection.objects
        self._objects.labels(self._camera, roi).set(len(objects))
        if detection.oversize is not None:
            sizes = [one.size for one in objects if one.size is not None]
            self._oversize.labels(self._camera, roi).set(detection.oversize)
            self._largest.labels(self._camera, roi).set(
                max((s.longest_mm or 0.0 for s in sizes), default=0.0)
            )
            times = [s.lip_s for s in sizes if s.lip_s is not None]
            self._lip.labels(self._camera, roi).set(min(times, default=float("inf")))
        means: dict[str, float] = {}
        for one in objects:
            for model, share in one.model_shares:
                means[model] = means.get(model, 0.0) + share / len(objects)
        for model, share in means.items():
            self._shares.labels(self._camera, roi, model).set(share)
        flagged = frozenset(one.id for one in objects if one.wrong_way)
        self._wrong_way.labels(self._camera, roi).inc(len(flagged - self._flagged.get(roi, frozenset())))
        self._flagged[roi] = flagged

    def state(
        self, roi: str, decision: Decision, existence: float, alarms: Mapping[AlarmClass, Alarm]
    ) -> None:
        """The present state of a ROI and its alarms."""
        self._existence.labels(self._camera, roi).set(existence)
        self._blind.labels(self._camera, roi).set(decision is Decision.BLIND)
        for alarm_class, alarm in alarms.items():
            labels = (self._camera, roi, alarm_class.value)
            self._active.labels(*labels).set(alarm.active)
            self._unacknowledged.labels(*labels).set(alarm.waits)
            self._shelved.labels(*labels).set(alarm.shelved is not None)
            self._suppressed.labels(*labels).set(bool(alarm.suppressed))
            self._out.labels(*labels).set(alarm.out_of_service is not None)

    def transition(self, roi: str, alarm_class: AlarmClass, transition: Transition) -> None:
        """An alarm changed."""
        self._transitions.labels(self._camera, roi, alarm_class.value, transition.change.value).inc()

    def refused(self, roi: str, request: str) -> None:
        """An operator or the plant asked for what is not allowed."""
        self._refused.labels(self._camera, roi, request).inc()

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
        """What lies in memory for the next clip."""
        self._pre_roll.labels(self._camera).set(seconds)

    def prior(self, roi: str, version: int, age_s: float) -> None:
        """The prior in use."""
        self._prior.labels(self._camera, roi).set(version)
        self._age.labels(self._camera, roi).set(age_s)

    def prior_refused(self, roi: str, reason: str) -> None:
        """A prior was refused."""
        self._problems.labels(self._camera, roi, reason).inc()


class DaemonMetrics:
    """Metrics of the daemon itself."""

    def __init__(self, registry: CollectorRegistry, version: str, store: Path) -> None:
        """`store` is the folder whose disk is watched."""
        Gauge(
            "lumpwatch_store_free_ratio", "Share of the store's disk that is free.", registry=registry
        ).set_function(lambda: _free(store))
        Gauge("lumpwatch_build_info", "Version of lumpwatch.", ("version",), registry=registry).labels(
            version
        ).set(1)
        self._restarts = Counter(
            "lumpwatch_process_restarts",
            "Worker processes that were started again; stage is camera or monitor, reason exited or stuck.",
            ("camera", "stage", "reason"),
            registry=registry,
        )

    def watched(self, camera: str, stage: str) -> None:
        """A worker process is watched: its first restart is to be seen as a rise from 0."""
        for reason in ("exited", "stuck"):
            self._restarts.labels(camera, stage, reason)

    def restarted(self, camera: str, stage: str, reason: str) -> None:
        """A worker process is started again."""
        self._restarts.labels(camera, stage, reason).inc()


def _free(folder: Path) -> float:
    """Share of the disk under the folder, or under the nearest one that exists, that is free to us."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        disk = os.statvfs(folder)
    except OSError:
        return 0.0  # a disk that does not answer has no room
    return disk.f_bavail / disk.f_blocks if disk.f_blocks else 0.0
