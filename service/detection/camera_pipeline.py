"""The pipeline of one camera: the quality of its picture, a channel for each region, blindness and its alarm.

Live monitoring and replay run this same object. It reads no clock: frames carry their times, and
`now_s` is on the clock of their `received_s`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from math import isfinite

from lumpwatch.models.roi import Roi
from lumpwatch.service.belt import camera_pace
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmClass,
    Frame,
    Pace,
    PlantFeed,
    RoiResult,
    Trouble,
    acknowledge,
    all_of,
)
from lumpwatch.service.detection.channel import Channel, RegionMisfitError
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.mouth_channel import MouthChannel
from lumpwatch.service.detection.observer import PipelineObserver, Unobserved
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.detection.region_channel import MakeDetector, RegionChannel
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.detection.watched_region import Newest, WatchedRegion
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, Reference

log = logging.getLogger(__name__)


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
        older: Mapping[str, Prior] | None = None,
        quality: CameraQuality | None = None,
        make: MakeDetector = make_detector,
    ) -> None:
        """`alarms` are those to go on with; others begin as NORMAL. `reference`: of the picture's quality. `older`:
        the priors that stand in for those that fail in use.

        `quality` judges the picture in the place of a judge of the pipeline's own; `make` makes the detectors.
        """
        priors = priors or {}
        self._config = config
        self._observer: PipelineObserver = observer or Unobserved()
        self.reference = reference
        """What a fit picture looks like; None: the stated defaults."""
        self._given = reference
        self.quality = quality or CameraQuality(
            config.id, config.quality, tuple(roi.id for roi in config.rois)
        )
        self._regions = {
            roi.id: WatchedRegion(
                config,
                self._channel(roi, priors.get(roi.id), make),
                self.quality,
                (older or {}).get(roi.id),
                self._observer,
            )
            for roi in config.rois
        }
        for (roi_id, alarm_class), alarm in (alarms or {}).items():
            if roi_id in self._regions:
                self._regions[roi_id].alarms.restore({alarm_class: alarm})
        self._pace = Pace()
        # What others hear of comes first.
        self._order = sorted(self._regions.values(), key=lambda region: region.channel.belt is not None)
        self._newest = Newest()
        self._last_s: float | None = None
        self._size: tuple[int, int] | None = None

    def _channel(self, roi: RoiConfig, prior: Prior | None, make: MakeDetector) -> Channel:
        """For what the region watches."""
        if roi.watches_mouth:
            return MouthChannel(roi, pictures=self.quality, listener=self._observer)
        return RegionChannel(
            roi,
            prior,
            pictures=self.quality,
            listener=self._observer,
            refused=lambda error: self._regions[roi.id].prior.refuse(error),
            make=make,
            feed=roi.feed.enabled,
        )

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the pictures; None before the first."""
        return self._size

    def detector(self, roi: str) -> Detector | None:
        """The detector of a ROI, for overlays; None before the first frame, and where the ROI does not fit it."""
        return self._regions[roi].channel.detector

    def geometry(self, roi: str) -> Roi | None:
        """Where a ROI lies; None before the first frame, and where it does not fit it."""
        return self._regions[roi].channel.geometry

    def check_fit(self) -> None:
        """Raises RegionMisfitError, saying why, where no ROI fits the pictures."""
        why = {roi_id: region.unfit for roi_id, region in self._regions.items()}
        if all(why.values()):
            reasons = "; ".join(f"roi {roi_id}: {reason}" for roi_id, reason in why.items())
            raise RegionMisfitError(f"camera {self._config.id}, {reasons}")

    def process(self, frame: Frame, now_s: float) -> tuple[RoiResult, ...]:
        """Filter and decide every ROI that is due on one frame; () for a frame that is not newer than the last.

        So for one whose times cannot be: it would make all that follow it look late. A ROI that does not fit the
        picture, or whose filter fails, is BLIND and leaves the others alone. Where a ROI is not due (`decide_hz`),
        what was decided last stands, as it does between frames.
        """
        if not _possible(frame, now_s):
            self._observer.dropped("future")
            return ()
        last_s = self._last_s
        if last_s is not None and frame.capture_s <= last_s:
            self._observer.dropped("duplicate" if frame.capture_s == last_s else "late")
            return ()
        if (frame.width, frame.height) != self._size:
            self._size = (frame.width, frame.height)
            self._fit()
        self._newest, self._last_s = Newest(frame, now_s), frame.capture_s
        if not self._take_due(frame.capture_s):
            return self.poll(now_s)
        try:
            self._look(frame, now_s)
        except Exception as error:  # no region is judged by what failed, and none is CLEAR
            for region in self._regions.values():
                region.failed(error, self._newest)
            return self.poll(now_s)
        for region in self._order:
            region.step(self._newest, now_s, self._regions)
        return tuple(region.result for region in self._regions.values() if region.result is not None)

    def _take_due(self, time_s: float) -> bool:
        """Whether any ROI is to be decided on the frame captured then; counts those that are not."""
        any_due = self._pace.take(time_s)
        for roi_id, region in self._regions.items():
            region.due = any_due and region.pace.take(time_s)
            if not region.due:
                self._observer.paced(roi_id)
        return any_due

    def _look(self, frame: Frame, now_s: float) -> None:
        """Judge the picture; a reference that cannot be judged by gives way to the stated defaults."""
        try:
            self.quality.picture(frame, now_s)
        except Exception:
            if self.reference is None:
                raise
            log.exception("%s: reference refused: it failed in use", self._config.id)
            self.reference = None
            self._given = None
            self._fit_quality(None, frame.width, frame.height)
            self.quality.picture(frame, now_s)

    def poll(self, now_s: float) -> tuple[RoiResult, ...]:
        """The decision of every ROI without a new frame: BLIND once the last one is too old."""
        return tuple(region.decide(self._newest, now_s) for region in self._regions.values())

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
        return region.decide(self._newest, now_s, region.alarms.apply(alarm_class, action, now_s))

    def plant(self, roi_id: str, said: PlantFeed | None) -> None:
        """What the plant says of a ROI's feed from now on; None: nothing. Raises KeyError for an unknown ROI."""
        self._regions[roi_id].plant.take(said)

    def snapshots(self) -> dict[str, Snapshot]:
        """Of every ROI, before the next frame."""
        return {roi_id: region.snapshot(self._pace) for roi_id, region in self._regions.items()}

    def restore(self, roi_id: str, snapshot: Snapshot) -> None:
        """Go on from there; the pipeline must have been made with the snapshot's prior.

        Raises StateMismatchError, and LumpwatchError where the ROI does not fit the picture.
        """
        region = self._regions[roi_id]
        region.restore(snapshot)
        self._pace.restore(snapshot.camera_pace)
        self._last_s, self._size = snapshot.last_capture_s, snapshot.size
        if self._size is not None:
            self._fit()

    def prior(self, roi_id: str) -> Prior | None:
        """The prior that a ROI uses; None: the stated defaults."""
        return self._regions[roi_id].channel.prior

    def use_prior(self, roi_id: str, prior: Prior | None) -> None:
        """Filter on with another prior (None: the defaults); what does not fit is refused, the old one stays."""
        region = self._regions[roi_id]
        if not region.prior.use(prior):
            return
        region.alarms.trouble(Trouble.PRIOR, present=False)
        if region.unfit is not None:
            self._fit()  # it may have been the prior that was missing

    def use_reference(self, reference: Reference) -> None:
        """Judge the picture by another reference from now on; one that does not fit is refused."""
        if self._size is None or self._fit_quality(reference, *self._size):
            self.reference = self._given = reference
        else:
            self._fit_quality(self.reference, *self._size)

    def _fit(self) -> None:
        """Fit every region to pictures of the present size, each for itself."""
        assert self._size is not None
        pace = camera_pace(self._config, *self._size)
        pace.restore(self._pace.state())
        self._pace, self.quality.decide_hz = pace, pace.rate_hz
        for region in self._regions.values():
            region.fit_pace(*self._size)
            region.fit(*self._size)
        # One that is refused for pictures of one size may fit the next.
        fits = self._fit_quality(self._given, *self._size)
        self.reference = self._given if fits else None
        if not fits:
            self._fit_quality(None, *self._size)

    def _fit_quality(self, reference: Reference | None, width: int, height: int) -> bool:
        """Judge pictures of that size by the reference from now on; False, and nothing said of what was before,
        where it does not fit.
        """
        channels = {roi_id: region.channel for roi_id, region in self._regions.items()}
        rois = {
            roi_id: channel.geometry
            for roi_id, channel in channels.items()
            if channel.size is not None and channel.geometry is not None
        }
        try:
            if reference is not None:
                reference.check_fits(self._config, width, height)
            mouths = tuple(roi.id for roi in self._config.rois if roi.watches_mouth)
            self.quality.fit(rois, width, height, reference, mouths)
        except LumpwatchError as error:
            log.error("%s: reference refused: %s", self._config.id, error)  # noqa: TRY400 - the line says it
            return False
        return True


_FUTURE_S = 0.05
"""A frame is received before it is decided on; so much is left to the reading of clocks."""


def _possible(frame: Frame, now_s: float) -> bool:
    """Whether it was captured before it was received, and received before `now_s`."""
    times = (frame.capture_s, frame.received_s)
    return all(isfinite(time_s) for time_s in times) and max(times) <= now_s + _FUTURE_S
