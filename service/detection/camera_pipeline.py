"""The pipeline of one camera: frame -> filter of each ROI -> decision -> alarms of both classes.

Live monitoring and replay run this same object. It reads no clock: frames carry their times, and
`now_s` is on the clock of their `received_s`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Protocol

from lumpwatch.service.config import AlarmConfig, CameraConfig, ConditionAlarmConfig, RoiConfig
from lumpwatch.service.core import (
    Act,
    Alarm,
    AlarmChange,
    AlarmClass,
    BlindReason,
    Changed,
    Decision,
    Detection,
    Frame,
    RoiResult,
    Trouble,
    acknowledge,
    all_of,
    announce_again,
    step_alarm,
    tick_alarm,
    working_colour,
    working_luma,
)
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.detection.region import make_region
from lumpwatch.service.detection.sizing import Sizer
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, Reference

log = logging.getLogger(__name__)


class PipelineObserver(Protocol):
    """Counts and times what happens in the pipeline; implemented by metrics."""

    def dropped(self, reason: str) -> None:
        """A frame was not processed."""

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """A stage of the work on one frame took this long."""

    def prior_refused(self, roi: str, reason: str) -> None:
        """A prior cannot be used."""


class Unobserved:
    """An observer that looks away."""

    def dropped(self, reason: str) -> None:
        """Nothing."""

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """Nothing."""

    def prior_refused(self, roi: str, reason: str) -> None:
        """Nothing."""


@dataclass(slots=True)
class _Roi:
    """What changes from frame to frame in one ROI."""

    config: RoiConfig
    prior: Prior | None
    detector: Detector | None = None
    sizer: Sizer | None = None
    alarms: dict[AlarmClass, Alarm] = field(default_factory=lambda: {one: Alarm() for one in AlarmClass})
    detection: Detection | None = None
    failed: bool = False
    troubles: frozenset[Trouble] = frozenset()
    announced: frozenset[Trouble] = frozenset()
    """Those that its system alarm has been announced for."""

    @property
    def version(self) -> int:
        return self.prior.version if self.prior else 0

    def rules(self, alarm_class: AlarmClass) -> AlarmConfig | ConditionAlarmConfig:
        return self.config.alarm.of_class(alarm_class)

    def take(self, alarm_class: AlarmClass, changed: Changed) -> tuple[AlarmChange, ...]:
        """The alarm is another one now."""
        alarm, made = changed
        self.alarms[alarm_class] = alarm
        priority = self.rules(alarm_class).priority
        return tuple(AlarmChange(alarm_class, one, alarm, priority) for one in made)


class CameraPipeline:
    """All ROIs of one camera."""

    def __init__(
        self,
        config: CameraConfig,
        priors: Mapping[str, Prior | None] | None = None,
        observer: PipelineObserver | None = None,
        alarms: Mapping[tuple[str, AlarmClass], Alarm] | None = None,
        reference: Reference | None = None,
    ) -> None:
        """`alarms` are those to go on with; others begin as NORMAL. `reference`: of the picture's quality."""
        priors = priors or {}
        self._config = config
        self._observer: PipelineObserver = observer or Unobserved()
        self._rois = {roi.id: _Roi(roi, priors.get(roi.id)) for roi in config.rois}
        for (roi, alarm_class), alarm in (alarms or {}).items():
            if roi in self._rois:
                self._rois[roi].alarms[alarm_class] = alarm
        self.reference = reference
        """What a fit picture looks like; None: the stated defaults."""
        self.quality = CameraQuality(config.id, config.quality, tuple(self._rois))
        self._frame: Frame | None = None
        self._last_s: float | None = None
        self._taken_s: float | None = None
        self._size: tuple[int, int] | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the pictures; None before the first."""
        return self._size

    def detector(self, roi: str) -> Detector | None:
        """The detector of a ROI, for overlays; None before the first frame."""
        return self._rois[roi].detector

    def process(self, frame: Frame, now_s: float) -> tuple[RoiResult, ...]:
        """Filter and decide every ROI on one frame; () for a frame that is not newer than the last.

        Raises LumpwatchError where a ROI or prior does not fit the picture.
        """
        last_s = self._last_s
        if last_s is not None and frame.capture_s <= last_s:
            self._observer.dropped("duplicate" if frame.capture_s == last_s else "late")
            return ()
        if (frame.width, frame.height) != self._size:
            self._fit(frame)
        dt = DEFAULT_INTERVAL_S if last_s is None else frame.capture_s - last_s
        self._frame, self._last_s, self._taken_s = frame, frame.capture_s, now_s
        self.quality.picture(frame, now_s)
        return tuple(self._process_roi(roi, frame, dt, now_s) for roi in self._rois.values())

    def look(self, now_s: float) -> tuple[RoiResult, ...]:
        """The decision of every ROI without a new frame: BLIND once the last one is too old."""
        return tuple(self._result(roi, (), now_s) for roi in self._rois.values())

    def trouble(self, roi_id: str, what: Trouble, *, present: bool) -> None:
        """Something keeps a ROI from judging as well as it must, or no longer does: judged with the next result."""
        roi = self._rois[roi_id]
        roi.troubles = roi.troubles | {what} if present else roi.troubles - {what}

    def acknowledge(
        self, roi_id: str, actor: str, now_s: float, alarm_class: AlarmClass = AlarmClass.LUMP
    ) -> RoiResult:
        """Acknowledge an alarm of a ROI; raises KeyError for one that does not exist."""
        return self.act(
            roi_id, alarm_class, lambda alarm, _, time_s: all_of(acknowledge(alarm, actor, time_s)), now_s
        )

    def act(self, roi_id: str, alarm_class: AlarmClass, act: Act, now_s: float) -> RoiResult:
        """Do something to an alarm; raises KeyError for a ROI that does not exist, and what `act` raises."""
        roi = self._rois[roi_id]
        changes = roi.take(alarm_class, act(roi.alarms[alarm_class], roi.rules(alarm_class), now_s))
        return self._result(roi, changes, now_s)

    def snapshots(self) -> dict[str, Snapshot]:
        """Of every ROI, before the next frame."""
        return {
            roi_id: Snapshot(
                self._last_s,
                self._size,
                None if roi.detector is None else roi.detector.state(),
                {} if roi.sizer is None else roi.sizer.state(),
                dict(roi.alarms),
                roi.prior,
            )
            for roi_id, roi in self._rois.items()
        }

    def restore(self, roi_id: str, snapshot: Snapshot) -> None:
        """Go on from there; the pipeline must have been made with the snapshot's prior.

        Raises StateMismatchError, and LumpwatchError where ROI or prior do not fit the picture.
        """
        roi = self._rois[roi_id]
        roi.alarms = roi.alarms | snapshot.alarms
        self._last_s, self._size = snapshot.last_capture_s, snapshot.size
        if snapshot.size is None:
            return
        roi.detector, roi.prior = self._make_detector(roi, *snapshot.size)
        roi.sizer = self._make_sizer(roi.config, *snapshot.size)
        if snapshot.filter is not None:
            roi.detector.restore(snapshot.filter)
        if roi.sizer is not None:
            roi.sizer.restore(snapshot.looks)

    def prior(self, roi_id: str) -> Prior | None:
        """The prior that a ROI uses; None: the stated defaults."""
        return self._rois[roi_id].prior

    def use_prior(self, roi_id: str, prior: Prior | None) -> None:
        """Filter on with another prior (None: the defaults); what does not fit is refused, the old one stays."""
        roi = self._rois[roi_id]
        if roi.detector is not None and self._size is not None:
            try:
                if prior is not None:
                    prior.check_fits(roi.config, *self._size)
                roi.detector.use(prior.learned if prior else None)
            except LumpwatchError as error:
                self._refuse(roi, error)
                return
        roi.prior = prior

    def use_reference(self, reference: Reference) -> None:
        """Judge the picture by another reference from now on; one that does not fit is refused."""
        wanted, before = reference, self.reference
        if self._size is not None:
            rois = {name: roi.detector.roi for name, roi in self._rois.items() if roi.detector is not None}
            self.reference = self._fitting(wanted, *self._size) or before
            self.quality.fit(rois, *self._size, self.reference)
        else:
            self.reference = wanted

    def _fitting(self, reference: Reference | None, width: int, height: int) -> Reference | None:
        try:
            if reference is not None:
                reference.check_fits(self._config, width, height)
        except LumpwatchError as error:
            log.error("%s: reference refused: %s", self._config.id, error)  # noqa: TRY400 - the line says it
            return None
        return reference

    def _refuse(self, roi: _Roi, error: LumpwatchError) -> None:
        log.error("%s/%s: prior refused: %s", self._config.id, roi.config.id, error)
        self._observer.prior_refused(roi.config.id, "unfit")

    def _fit(self, frame: Frame) -> None:
        """Make the detectors for pictures of this size; where one cannot be made, all stay as they were."""
        size = (frame.width, frame.height)
        made = {roi_id: self._make_detector(roi, *size) for roi_id, roi in self._rois.items()}
        sizers = {roi_id: self._make_sizer(roi.config, *size) for roi_id, roi in self._rois.items()}
        for roi_id, (detector, prior) in made.items():
            roi = self._rois[roi_id]
            roi.detector, roi.prior, roi.sizer = detector, prior, sizers[roi_id]
        self._size = size
        self.reference = self._fitting(self.reference, *size)
        rois = {roi_id: detector.roi for roi_id, (detector, _) in made.items()}
        self.quality.fit(rois, *size, self.reference)

    def _make_sizer(self, roi: RoiConfig, width: int, height: int) -> Sizer | None:
        if roi.calibration is None:
            return None
        try:
            return Sizer(roi.calibration, width, height, roi.alarm.oversize_above)
        except LumpwatchError as error:
            raise LumpwatchError(f"camera {self._config.id}, roi {roi.id}: {error}") from error

    def _make_detector(self, roi: _Roi, width: int, height: int) -> tuple[Detector, Prior | None]:
        config = roi.config.detector
        try:
            geometry = make_region(roi.config, width, height)
        except ValueError as error:
            raise LumpwatchError(f"camera {self._config.id}, roi {roi.config.id}: {error}") from error
        if roi.prior is not None:
            try:
                roi.prior.check_fits(roi.config, width, height)
                return make_detector(config, geometry, roi.prior.learned), roi.prior
            except LumpwatchError as error:
                self._refuse(roi, error)
        return make_detector(config, geometry, None), None

    def _process_roi(self, roi: _Roi, frame: Frame, dt: float, now_s: float) -> RoiResult:
        assert roi.detector is not None
        started = perf_counter()
        try:
            # The detector thinks where the camera looked at first; only what goes in and out is moved.
            place, offset = self.quality.placed(roi.config.id, roi.detector.roi, frame.width, frame.height)
            gray = working_luma(frame, place)
            colour = working_colour(frame, place) if roi.config.detector.needs_colour else None
            cut = perf_counter()
            self.quality.look(roi.config.id, gray, frame.capture_s)
            looked = perf_counter()
            roi.detector.learns = self._teaches(roi, now_s)
            detection = roi.detector.step(gray, colour, dt)
            if roi.sizer is not None:
                detection = roi.sizer.measure(detection, frame.capture_s)
            roi.detection = detection.moved(*offset)
            roi.failed = False
        except Exception:
            # One ROI that fails must not take the camera with it: it goes blind and starts anew.
            log.exception("camera %s, roi %s: the filter failed", self._config.id, roi.config.id)
            roi.failed = True
            roi.detector = make_detector(
                roi.config.detector, roi.detector.roi, roi.prior.learned if roi.prior else None
            )
            return self._result(roi, (), now_s)
        done = perf_counter()
        self._observer.stage("cut", roi.config.id, cut - started)
        self._observer.stage("quality", roi.config.id, looked - cut)
        self._observer.stage("filter", roi.config.id, done - looked)
        self.quality.filtered(roi.config.id, roi.detection, frame.capture_s)
        evidence = self._evidence(roi, roi.detection.alarming)
        stepped = step_alarm(roi.alarms[AlarmClass.LUMP], roi.config.alarm, evidence, frame.capture_s)
        return self._result(roi, roi.take(AlarmClass.LUMP, all_of(stepped)), now_s, decided=True)

    def _teaches(self, roi: _Roi, now_s: float) -> bool:
        """Whether the picture may teach anything: a background model must not learn what covers the lens."""
        quality = self.quality.judged(roi.config.id)
        return quality.reason is None and not quality.suspect and self._blind(roi, now_s) is None

    def _evidence(self, roi: _Roi, alarming: float) -> float:
        """What the lump alarm may judge: a picture that is not fit clears no alarm.

        It may still raise one, except in the hold-off after the exposure has jumped.
        """
        quality, rules = self.quality.judged(roi.config.id), roi.config.alarm
        if quality.reason is None and not quality.suspect:
            return alarming
        if roi.alarms[AlarmClass.LUMP].active:
            return max(alarming, rules.clear_below)
        return min(alarming, rules.raise_above) if quality.held_off else alarming

    def _result(
        self, roi: _Roi, changes: tuple[AlarmChange, ...], now_s: float, *, decided: bool = False
    ) -> RoiResult:
        quality = self.quality.judged(roi.config.id)
        reason = self._blind(roi, now_s) or quality.reason
        changes += self._judge_blindness(roi, reason, now_s) + self._judge_system(roi, now_s)
        for alarm_class in AlarmClass:
            changes += roi.take(
                alarm_class, tick_alarm(roi.alarms[alarm_class], roi.rules(alarm_class), now_s)
            )
        clear_or_lump = Decision.LUMP if roi.alarms[AlarmClass.LUMP].active else Decision.CLEAR
        decision = clear_or_lump if reason is None else Decision.BLIND
        existence = roi.detection.existence if roi.detection else 0.0
        return RoiResult(
            roi.config.id,
            self._frame,
            decision,
            reason,
            roi.detection,
            existence,
            dict(roi.alarms),
            roi.version,
            decided,
            changes,
            self._taken_s,
            quality,
        )

    def _judge_blindness(
        self, roi: _Roi, reason: BlindReason | None, now_s: float
    ) -> tuple[AlarmChange, ...]:
        blind = 0.0 if reason is None else 1.0
        alarm, made = step_alarm(roi.alarms[AlarmClass.BLIND], roi.config.alarm.blind, blind, now_s)
        if made is not None and reason is not None:
            made = replace(made, reason=reason.value)
        return roi.take(AlarmClass.BLIND, all_of((alarm, made)))

    def _judge_system(self, roi: _Roi, now_s: float) -> tuple[AlarmChange, ...]:
        before = roi.alarms[AlarmClass.SYSTEM]
        rules = roi.rules(AlarmClass.SYSTEM)
        alarm, made = step_alarm(before, rules, 1.0 if roi.troubles else 0.0, now_s)
        new = roi.troubles - roi.announced
        if made is None and alarm.active and new and roi.announced:
            alarm, made = announce_again(alarm, now_s)
        roi.announced = roi.troubles if alarm.active else frozenset()
        if made is not None and roi.troubles:
            made = replace(made, reason=", ".join(sorted(roi.troubles)))
        return roi.take(AlarmClass.SYSTEM, all_of((alarm, made)))

    def _blind(self, roi: _Roi, now_s: float) -> BlindReason | None:
        if self._frame is None:
            return BlindReason.STARTING
        if roi.failed:
            return BlindReason.FILTER
        if now_s - self._frame.received_s > self._config.blind_after_s:
            return BlindReason.NO_STREAM
        if now_s - self._frame.capture_s > self._config.blind_after_s:
            return BlindReason.STALE
        return None
