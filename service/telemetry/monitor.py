"""The metrics of the process that filters one camera's regions: decisions, alarms, priors.

Those of the picture, of shadows and of proof tests are in `picture`, `shadow` and `proof`, those of what is kept
in `records`.
"""

from __future__ import annotations

from collections.abc import Mapping

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from lumpwatch.service.core import Alarm, AlarmClass, Change, Decision, Detection, Transition
from lumpwatch.service.protocol import COMMANDS, Latency
from lumpwatch.service.telemetry.feed import FeedMetrics
from lumpwatch.service.telemetry.frames import BUCKETS, FrameMetrics
from lumpwatch.service.telemetry.mouth import MouthMetrics
from lumpwatch.service.telemetry.picture import PictureMetrics
from lumpwatch.service.telemetry.process import ProcessMetrics
from lumpwatch.service.telemetry.records import RecordMetrics
from lumpwatch.service.telemetry.shadow import ShadowMetrics


class MonitorMetrics(FrameMetrics, RecordMetrics):
    """Metrics of the process that filters one camera's ROIs."""

    def __init__(self, registry: CollectorRegistry, camera: str, rois: tuple[str, ...]) -> None:
        FrameMetrics.__init__(self, registry, camera)
        RecordMetrics.__init__(self, registry, camera, rois)
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
            buckets=BUCKETS,
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
            "lumpwatch_alarm_changes",
            "Changes of the alarm, such as raised, cleared or acknowledged.",
            (*of_alarm, "change"),
            registry=registry,
        )
        self._why = Gauge(
            "lumpwatch_alarm_reason",
            "1 for the reason that the alarm was last raised for, while its condition holds.",
            (*of_alarm, "reason"),
            registry=registry,
        )
        self._refused = Counter(
            "lumpwatch_commands_refused",
            "Queries and puts that asked for what is not allowed; command is the key's last part.",
            (*labels, "command"),
            registry=registry,
        )
        self._effective = gauge("lumpwatch_effective_particles", "Effective number of particles.")
        self._fallback = gauge(
            "lumpwatch_switching_fallback_ratio",
            "Share of particles far from all training data, for which switching fell back on the matrix.",
        )
        self._prior = gauge("lumpwatch_prior_version", "Version of the prior in use; 0: stated defaults.")
        self._created = gauge(
            "lumpwatch_prior_created_timestamp_seconds", "When the prior in use was learned; NaN: none is."
        )
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
            "lumpwatch_largest_meters", "Longest diameter of the largest lump; 0: none is known."
        )
        self._lip = gauge(
            "lumpwatch_lip_seconds", "Seconds until the first lump reaches the lip; +Inf: none is on its way."
        )
        self._budget = gauge(
            "lumpwatch_latency_budget_ratio",
            "Share of the latency budget that the last decision took, from capture to publication.",
        )
        self.picture = PictureMetrics(registry, camera, rois)
        self.feed = FeedMetrics(registry, camera)
        self.mouth = MouthMetrics(registry, camera)
        self._flagged: dict[str, frozenset[int]] = {}
        self._reasons: dict[tuple[str, str, str], str] = {}
        ProcessMetrics(registry, camera, "monitor")
        for roi in rois:
            self._wrong_way.labels(camera, roi)
            self._processed.labels(camera, roi)
            self._paced.labels(camera, roi)
            self._blind.labels(camera, roi).set(1)
            for command in COMMANDS:
                self._refused.labels(camera, roi, command)
            for alarm_class in AlarmClass:
                for change in Change:
                    self._transitions.labels(camera, roi, alarm_class.value, change.value)

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
        objects = detection.counted
        self._objects.labels(self._camera, roi).set(len(objects))
        if detection.oversize is not None:
            sizes = [item.size for item in objects if item.size is not None]
            self._oversize.labels(self._camera, roi).set(detection.oversize)
            self._largest.labels(self._camera, roi).set(
                max((s.longest_mm or 0.0 for s in sizes), default=0.0) / 1000.0
            )
            times = [s.lip_s for s in sizes if s.lip_s is not None]
            self._lip.labels(self._camera, roi).set(min(times, default=float("inf")))
        means: dict[str, float] = {}
        for item in objects:
            for model, share in item.model_shares:
                means[model] = means.get(model, 0.0) + share / len(objects)
        for model, share in means.items():
            self._shares.labels(self._camera, roi, model).set(share)
        flagged = frozenset(item.id for item in objects if item.wrong_way)
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
        of_alarm = (self._camera, roi, alarm_class.value)
        if transition.change in (Change.RAISED, Change.RE_ALARMED, Change.CLEARED) and (
            before := self._reasons.pop(of_alarm, None)
        ):
            self._why.labels(*of_alarm, before).set(0)
        if transition.change in (Change.RAISED, Change.RE_ALARMED) and transition.reason:
            self._reasons[of_alarm] = transition.reason
            self._why.labels(*of_alarm, transition.reason).set(1)

    def refused(self, roi: str, request: str) -> None:
        """An operator or the plant asked for what is not allowed."""
        self._refused.labels(self._camera, roi, request).inc()

    def prior(self, roi: str, version: int, created_s: float) -> None:
        """The prior in use, and when it was learned, seconds since the epoch; NaN where none is."""
        self._prior.labels(self._camera, roi).set(version)
        self._created.labels(self._camera, roi).set(created_s)

    def prior_refused(self, roi: str, reason: str) -> None:
        """A prior was refused."""
        self._problems.labels(self._camera, roi, reason).inc()
