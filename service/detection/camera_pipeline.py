"""The pipeline of one camera: the quality of its picture, a channel for each region, blindness and its alarm.

Live monitoring and replay run this same object. It reads no clock: frames carry their times, and
`now_s` is on the clock of their `received_s`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmChange,
    AlarmClass,
    BlindReason,
    Decision,
    Frame,
    RoiResult,
    Trouble,
    acknowledge,
    all_of,
)
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.observer import PipelineObserver, Unobserved
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.detection.region_alarms import RegionAlarms
from lumpwatch.service.detection.region_channel import MakeDetector, RegionChannel, RegionMisfitError
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, Reference

log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Region:
    """One region, and why it cannot judge."""

    channel: RegionChannel
    alarms: RegionAlarms
    unfit: str | None = None
    """Why it does not fit the picture."""
    failed: bool = False


class CameraPipeline:
    """All ROIs of one camera."""

    def __init__(
        self,
        config: CameraConfig,
        priors: Mapping[str, Prior | None] | None = None,
        *,
        observer: PipelineObserver | None = None,
        alarms: Mapping[tuple[str, AlarmClass], Alarm] | None = None,
        reference: Reference | None = None,
        quality: CameraQuality | None = None,
        make: MakeDetector = make_detector,
    ) -> None:
        """`alarms` are those to go on with; others begin as NORMAL. `reference`: of the picture's quality.

        `quality` judges the picture in the place of a judge of the pipeline's own; `make` makes the detectors.
        """
        priors = priors or {}
        self._config = config
        self._observer: PipelineObserver = observer or Unobserved()
        self.reference = reference
        """What a fit picture looks like; None: the stated defaults."""
        self.quality = quality or CameraQuality(
            config.id, config.quality, tuple(roi.id for roi in config.rois)
        )
        self._regions: dict[str, _Region] = {}
        for roi in config.rois:
            channel = RegionChannel(
                roi,
                priors.get(roi.id),
                pictures=self.quality,
                listener=self._observer,
                refused=partial(self._refuse, roi.id),
                make=make,
            )
            self._regions[roi.id] = _Region(channel, RegionAlarms(channel))
        for (roi_id, alarm_class), alarm in (alarms or {}).items():
            if roi_id in self._regions:
                self._regions[roi_id].alarms.restore({alarm_class: alarm})
        self._frame: Frame | None = None
        self._last_s: float | None = None
        self._taken_s: float | None = None
        self._size: tuple[int, int] | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the pictures; None before the first."""
        return self._size

    def detector(self, roi: str) -> Detector | None:
        """The detector of a ROI, for overlays; None before the first frame, and where the ROI does not fit it."""
        return self._regions[roi].channel.detector

    def check_fit(self) -> None:
        """Raises RegionMisfitError, saying why, where no ROI fits the pictures."""
        why = {roi_id: region.unfit for roi_id, region in self._regions.items()}
        if all(why.values()):
            reasons = "; ".join(f"roi {roi_id}: {reason}" for roi_id, reason in why.items())
            raise RegionMisfitError(f"camera {self._config.id}, {reasons}")

    def process(self, frame: Frame, now_s: float) -> tuple[RoiResult, ...]:
        """Filter and decide every ROI on one frame; () for a frame that is not newer than the last.

        A ROI that does not fit the picture, or whose filter fails, is BLIND and leaves the others alone.
        """
        last_s = self._last_s
        if last_s is not None and frame.capture_s <= last_s:
            self._observer.dropped("duplicate" if frame.capture_s == last_s else "late")
            return ()
        if (frame.width, frame.height) != self._size:
            self._size = (frame.width, frame.height)
            self._fit()
        self._frame, self._last_s, self._taken_s = frame, frame.capture_s, now_s
        self.quality.picture(frame, now_s)
        return tuple(self._process_region(region, frame, now_s) for region in self._regions.values())

    def poll(self, now_s: float) -> tuple[RoiResult, ...]:
        """The decision of every ROI without a new frame: BLIND once the last one is too old."""
        return tuple(self._result(region, (), now_s) for region in self._regions.values())

    def trouble(self, roi_id: str, what: Trouble, *, present: bool) -> None:
        """Something keeps a ROI from judging as well as it must, or no longer does: judged with the next result."""
        self._regions[roi_id].alarms.trouble(what, present=present)

    def acknowledge(
        self, roi_id: str, actor: str, now_s: float, alarm_class: AlarmClass = AlarmClass.LUMP
    ) -> RoiResult:
        """Acknowledge an alarm of a ROI; raises KeyError for one that does not exist."""
        return self.apply(
            roi_id, alarm_class, lambda alarm, _, time_s: all_of(acknowledge(alarm, actor, time_s)), now_s
        )

    def apply(self, roi_id: str, alarm_class: AlarmClass, action: AlarmAction, now_s: float) -> RoiResult:
        """Do something to an alarm; raises KeyError for a ROI that does not exist, and what `action` raises."""
        region = self._regions[roi_id]
        return self._result(region, region.alarms.apply(alarm_class, action, now_s), now_s)

    def snapshots(self) -> dict[str, Snapshot]:
        """Of every ROI, before the next frame."""
        return {
            roi_id: replace(region.channel.snapshot(), alarms=region.alarms.now())
            for roi_id, region in self._regions.items()
        }

    def restore(self, roi_id: str, snapshot: Snapshot) -> None:
        """Go on from there; the pipeline must have been made with the snapshot's prior.

        Raises StateMismatchError, and LumpwatchError where the ROI does not fit the picture.
        """
        region = self._regions[roi_id]
        region.alarms.restore(snapshot.alarms)
        region.channel.restore(snapshot)
        self._last_s, self._size = snapshot.last_capture_s, snapshot.size

    def prior(self, roi_id: str) -> Prior | None:
        """The prior that a ROI uses; None: the stated defaults."""
        return self._regions[roi_id].channel.prior

    def use_prior(self, roi_id: str, prior: Prior | None) -> None:
        """Filter on with another prior (None: the defaults); what does not fit is refused, the old one stays."""
        region = self._regions[roi_id]
        try:
            region.channel.use(prior)
        except LumpwatchError as error:
            self._refuse(roi_id, error)
            return
        if region.unfit is not None:
            self._fit()  # it may have been the prior that was missing

    def use_reference(self, reference: Reference) -> None:
        """Judge the picture by another reference from now on; one that does not fit is refused."""
        if self._size is None:
            self.reference = reference
            return
        self.reference = self._fitting(reference, *self._size) or self.reference
        self._fit_quality(*self._size)

    def _fitting(self, reference: Reference | None, width: int, height: int) -> Reference | None:
        try:
            if reference is not None:
                reference.check_fits(self._config, width, height)
        except LumpwatchError as error:
            log.error("%s: reference refused: %s", self._config.id, error)  # noqa: TRY400 - the line says it
            return None
        return reference

    def _refuse(self, roi_id: str, error: LumpwatchError) -> None:
        log.error("%s/%s: prior refused: %s", self._config.id, roi_id, error)
        self._observer.prior_refused(roi_id, "unfit")

    def _fit(self) -> None:
        """Fit every region to pictures of the present size, each for itself."""
        assert self._size is not None
        for region in self._regions.values():
            self._fit_region(region, *self._size)
        self.reference = self._fitting(self.reference, *self._size)
        self._fit_quality(*self._size)

    def _fit_region(self, region: _Region, width: int, height: int) -> None:
        try:
            region.channel.fit(width, height)
        except Exception as error:  # whatever it is: it must not take the other regions with it
            region.unfit = str(error) or type(error).__name__
            log.error(  # noqa: TRY400 - the line says it, unless it is a surprise
                "camera %s, roi %s: unfit for pictures of %d x %d, the region is blind: %s",
                self._config.id,
                region.channel.config.id,
                width,
                height,
                region.unfit,
                exc_info=None if isinstance(error, LumpwatchError) else error,
            )
        else:
            region.unfit = None

    def _fit_quality(self, width: int, height: int) -> None:
        detectors = {roi_id: region.channel.detector for roi_id, region in self._regions.items()}
        rois = {roi_id: detector.roi for roi_id, detector in detectors.items() if detector is not None}
        self.quality.fit(rois, width, height, self.reference)

    def _process_region(self, region: _Region, frame: Frame, now_s: float) -> RoiResult:
        if region.unfit is not None:
            return self._result(region, (), now_s)
        try:
            transition = region.channel.step(frame, now_s=now_s, may_learn=self._blind(region, now_s) is None)
        except Exception:
            # One ROI that fails must not take the camera with it: it goes blind and starts anew.
            log.exception("camera %s, roi %s: the filter failed", self._config.id, region.channel.config.id)
            region.failed = True
            region.channel.begin_anew()
            return self._result(region, (), now_s)
        region.failed = False
        return self._result(region, region.alarms.stepped(transition), now_s, decided=True)

    def _result(
        self, region: _Region, changes: tuple[AlarmChange, ...], now_s: float, *, decided: bool = False
    ) -> RoiResult:
        channel = region.channel
        quality = self.quality.current(channel.config.id)
        reason = self._blind(region, now_s) or quality.reason
        changes += region.alarms.tick(_reason_text(reason, region), now_s)
        clear_or_lump = Decision.LUMP if channel.alarm.active else Decision.CLEAR
        return RoiResult(
            roi=channel.config.id,
            frame=self._frame,
            decision=clear_or_lump if reason is None else Decision.BLIND,
            reason=reason,
            detection=channel.detection,
            existence=channel.detection.existence if channel.detection else 0.0,
            alarms=region.alarms.now(),
            prior=channel.prior.version if channel.prior else 0,
            decided=decided,
            changes=changes,
            taken_s=self._taken_s,
            quality=quality,
        )

    def _blind(self, region: _Region, now_s: float) -> BlindReason | None:
        if self._frame is None:
            return BlindReason.STARTING
        if region.unfit is not None:
            return BlindReason.UNFIT
        if region.failed:
            return BlindReason.FILTER
        if now_s - self._frame.received_s > self._config.blind_after_s:
            return BlindReason.NO_STREAM
        if now_s - self._frame.capture_s > self._config.blind_after_s:
            return BlindReason.STALE
        return None


def _reason_text(reason: BlindReason | None, region: _Region) -> str | None:
    """The reason in the record of the alarm, with what is known besides."""
    if reason is BlindReason.UNFIT:
        return f"{reason.value}: {region.unfit}"
    return None if reason is None else reason.value
