"""The pipeline of one camera: the quality of its picture, a channel for each region, blindness and its alarm.

Live monitoring and replay run this same object. It reads no clock: frames carry their times, and
`now_s` is on the clock of their `received_s`.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite

from lumpwatch.models.roi import Roi
from lumpwatch.service.belt import camera_pace, make_pace, ride_s
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmChange,
    AlarmClass,
    BlindReason,
    Decision,
    FeedState,
    FeedStatus,
    Frame,
    Pace,
    PictureQuality,
    PlantFeed,
    RoiResult,
    Trouble,
    acknowledge,
    all_of,
)
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.mouth_channel import MouthChannel
from lumpwatch.service.detection.observer import PipelineObserver, Unobserved
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.detection.plant_signal import PlantSignal
from lumpwatch.service.detection.region_alarms import RegionAlarms
from lumpwatch.service.detection.region_channel import MakeDetector, RegionChannel, RegionMisfitError
from lumpwatch.service.detection.sight import Sight
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, Reference

log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Region:
    """One region, and why it cannot judge."""

    channel: RegionChannel | MouthChannel
    alarms: RegionAlarms
    sight: Sight
    plant: PlantSignal
    unfit: str | None = None
    """Why it does not fit the picture."""
    last_s: float | None = None
    """When it last judged a frame, on the clock of `now_s`."""
    before: Prior | None = None
    """The prior before the one in use; None: the stated defaults."""
    failures_s: deque[float] = field(default_factory=deque)
    """When the filter has failed lately."""
    told: set[str] = field(default_factory=set)
    """Failures of the filter whose traceback is in the log."""
    pace: Pace = field(default_factory=Pace)
    """Which frames it is decided on."""
    due: bool = True
    """Whether the present one is among them."""
    result: RoiResult | None = None
    """Of the newest frame; None before the first, and where it failed."""


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
        self._regions: dict[str, _Region] = {}
        for roi in config.rois:
            channel: RegionChannel | MouthChannel
            if roi.watches_mouth:
                channel = MouthChannel(roi, pictures=self.quality, listener=self._observer)
            else:
                channel = RegionChannel(
                    roi,
                    priors.get(roi.id),
                    pictures=self.quality,
                    listener=self._observer,
                    refused=partial(self._refuse, roi.id),
                    make=make,
                    feed=roi.feed.enabled,
                )
            sight = Sight(config.sight, config.blind_after_s)
            before = (older or {}).get(roi.id)
            self._regions[roi.id] = _Region(
                channel, RegionAlarms(channel), sight, PlantSignal(roi.feed), before=before
            )
        for (roi_id, alarm_class), alarm in (alarms or {}).items():
            if roi_id in self._regions:
                self._regions[roi_id].alarms.restore({alarm_class: alarm})
        self._pace = Pace()
        # Belts first: a mouth hears of them what comes.
        self._order = sorted(self._regions.values(), key=lambda region: region.channel.config.watches_mouth)
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
        self._frame, self._last_s, self._taken_s = frame, frame.capture_s, now_s
        if not self._take_due(frame.capture_s):
            return self.poll(now_s)
        try:
            self._look(frame, now_s)
        except Exception as error:  # no region is judged by what failed, and none is CLEAR
            for region in self._regions.values():
                self._fail(region, error)
            return self.poll(now_s)
        for region in self._order:
            region.result = self._process_region(region, frame, now_s)
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

    def plant(self, roi_id: str, said: PlantFeed | None) -> None:
        """What the plant says of a ROI's feed from now on; None: nothing. Raises KeyError for an unknown ROI."""
        self._regions[roi_id].plant.take(said)

    def snapshots(self) -> dict[str, Snapshot]:
        """Of every ROI, before the next frame."""
        return {
            roi_id: replace(
                region.channel.snapshot(),
                alarms=region.alarms.now(),
                sight=region.sight.state(),
                pace=region.pace.state(),
                camera_pace=self._pace.state(),
            )
            for roi_id, region in self._regions.items()
        }

    def restore(self, roi_id: str, snapshot: Snapshot) -> None:
        """Go on from there; the pipeline must have been made with the snapshot's prior.

        Raises StateMismatchError, and LumpwatchError where the ROI does not fit the picture.
        """
        region = self._regions[roi_id]
        region.alarms.restore(snapshot.alarms)
        region.channel.restore(snapshot)
        region.sight.restore(snapshot.sight)
        self._last_s, self._size = snapshot.last_capture_s, snapshot.size
        if self._size is not None:
            self._fit()
        region.pace.restore(snapshot.pace)
        self._pace.restore(snapshot.camera_pace)

    def prior(self, roi_id: str) -> Prior | None:
        """The prior that a ROI uses; None: the stated defaults."""
        return self._regions[roi_id].channel.prior

    def use_prior(self, roi_id: str, prior: Prior | None) -> None:
        """Filter on with another prior (None: the defaults); what does not fit is refused, the old one stays."""
        region = self._regions[roi_id]
        before = region.channel.prior
        try:
            region.channel.use(prior)
        except LumpwatchError as error:
            self._refuse(roi_id, error)
            return
        region.before = before
        region.failures_s.clear()
        region.alarms.trouble(Trouble.PRIOR, present=False)
        if region.unfit is not None:
            self._fit()  # it may have been the prior that was missing

    def use_reference(self, reference: Reference) -> None:
        """Judge the picture by another reference from now on; one that does not fit is refused."""
        if self._size is None or self._fit_quality(reference, *self._size):
            self.reference = self._given = reference
        else:
            self._fit_quality(self.reference, *self._size)

    def _refuse(self, roi_id: str, error: LumpwatchError) -> None:
        log.error("%s/%s: prior refused: %s", self._config.id, roi_id, error)
        self._observer.prior_refused(roi_id, "unfit")

    def _fit(self) -> None:
        """Fit every region to pictures of the present size, each for itself."""
        assert self._size is not None
        self._fit_pace(*self._size)
        for region in self._regions.values():
            self._fit_region(region, *self._size)
        # One that is refused for pictures of one size may fit the next.
        fits = self._fit_quality(self._given, *self._size)
        self.reference = self._given if fits else None
        if not fits:
            self._fit_quality(None, *self._size)

    def _fit_region(self, region: _Region, width: int, height: int) -> None:
        try:
            if region.channel.size != (width, height):
                region.channel.fit(width, height)
                region.sight.begin()
            region.sight.ride(ride_s(region.channel.config, width, height))
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

    def _fit_pace(self, width: int, height: int) -> None:
        """How often to decide, in pictures of that size."""
        self._pace = _going_on(camera_pace(self._config, width, height), self._pace)
        self.quality.decide_hz = self._pace.rate_hz
        for region in self._regions.values():
            wanted = make_pace(region.channel.config, self._config.sight, width, height)
            region.pace = _going_on(wanted, region.pace)

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

    def _process_region(self, region: _Region, frame: Frame, now_s: float) -> RoiResult:
        if region.unfit is not None or not region.due:
            return self._result(region, (), now_s)
        may_learn = self._unseen(now_s) is None
        may_clear = may_learn and region.sight.reason(frame.capture_s) is None
        try:
            if isinstance(region.channel, MouthChannel):
                self._tell(region.channel, region.plant, now_s)
            transition = region.channel.step(frame, now_s=now_s, may_learn=may_learn, may_clear=may_clear)
        except Exception as error:
            # One ROI that fails must not take the camera with it: it goes blind and starts anew.
            self._fail(region, error)
            return self._result(region, (), now_s)
        region.sight.judged(frame.capture_s)
        region.last_s = now_s
        changes = region.alarms.stepped(transition)
        if isinstance(region.channel, MouthChannel):
            changes += region.alarms.looked(region.channel, now_s, may_clear=may_clear)
        return self._result(region, changes, now_s, decided=True)

    def _tell(self, mouth: MouthChannel, plant: PlantSignal, now_s: float) -> None:
        """What its belt's region says of this frame, to a mouth."""
        belt = self._regions.get(mouth.config.mouth.belt or "")
        says = plant.runs(now_s)
        if belt is None or belt.result is None:
            mouth.hear(FeedStatus(), says, None)
            return
        sees = belt.result.decision is not Decision.BLIND and belt.result.feed is not None
        feed = belt.result.feed if sees and belt.result.feed is not None else FeedStatus()
        said = belt.plant.runs(now_s) if says is None else says
        mouth.hear(replace(feed, plant=None, agrees=None, visible=None), said, belt.result.detection)

    def _fail(self, region: _Region, error: Exception) -> None:
        """The filter failed: it begins anew, and the region is BLIND until it has looked for long enough again."""
        self._observer.dropped("failed")
        region.sight.begin(failed=True)
        what = f"{type(error).__name__}: {error}"
        if what not in region.told and len(region.told) < _MOST_TOLD:
            region.told.add(what)
            log.error(
                "camera %s, roi %s: the filter failed and begins anew; told once, further failures are counted",
                self._config.id,
                region.channel.config.id,
                exc_info=error,
            )
        if self._fails_for_good(region):
            self._give_way(region)
        if region.unfit is None:
            try:
                region.channel.begin_anew()
            except Exception:
                region.unfit = what
                log.exception(
                    "%s/%s: the filter cannot begin anew", self._config.id, region.channel.config.id
                )

    def _fails_for_good(self, region: _Region) -> bool:
        """Whether the filter fails again and again with the prior in use."""
        if region.channel.prior is None or self._taken_s is None:
            return False
        region.failures_s.append(self._taken_s)
        while region.failures_s[0] < self._taken_s - _FAILS_WITHIN_S:
            region.failures_s.popleft()
        return len(region.failures_s) >= _MOST_FAILURES

    def _give_way(self, region: _Region) -> None:
        """The prior in use fails: the one before stands in for it, or the stated defaults, and an alarm says so.

        Where neither can be used (some likelihoods need a prior) it stays, and the filter goes on trying.
        """
        channel, prior = region.channel, region.channel.prior
        assert prior is not None
        before = region.before
        others = [None] if before is None or before.version == prior.version else [before, None]
        in_its_place = "nothing can stand"
        for other in others:
            try:
                channel.use(other)
            except Exception:
                continue  # this one fails as well
            in_its_place = "the stated defaults" if other is None else f"version {other.version}"
            break
        log.error(
            "%s/%s: prior refused: version %d fails in use; %s in its place",
            self._config.id,
            channel.config.id,
            prior.version,
            in_its_place,
        )
        region.before = None
        region.failures_s.clear()
        region.alarms.trouble(Trouble.PRIOR, present=True)
        self._observer.prior_refused(channel.config.id, "failed")

    def _result(
        self, region: _Region, changes: tuple[AlarmChange, ...], now_s: float, *, decided: bool = False
    ) -> RoiResult:
        channel = region.channel
        quality = self.quality.current(channel.config.id)
        reason = self._blind(region, now_s) or _unfit(region.channel, quality)
        short = None if reason is not None else region.sight.reason(now_s) or _unknown(region.channel)
        seen = reason is None and short is None
        feed = self._feed(region, now_s, seen=seen)
        changes += region.alarms.tick(_reason_text(reason or short, region), now_s)
        # What was found in a fit picture counts however few were looked at; that nothing was found does not.
        alarming = region.alarms.decides
        if not (alarming and region.last_s is not None and short in _LUMP_COUNTS):
            reason = reason or short
        found = Decision.BLOCKED if channel.config.watches_mouth else Decision.LUMP
        clear_or_found = found if alarming else Decision.CLEAR
        return RoiResult(
            roi=channel.config.id,
            frame=self._frame,
            decision=clear_or_found if reason is None else Decision.BLIND,
            reason=reason,
            detection=channel.detection,
            existence=channel.detection.existence if channel.detection else 0.0,
            alarms=region.alarms.now(),
            prior=channel.prior.version if channel.prior else 0,
            decided=decided,
            changes=changes,
            taken_s=self._taken_s,
            quality=quality,
            feed=feed,
            blockage=channel.blockage if isinstance(channel, MouthChannel) else None,
        )

    def _feed(self, region: _Region, now_s: float, *, seen: bool) -> FeedStatus | None:
        """What the feed does, beside what the plant says."""
        if not region.channel.config.feed.enabled:
            return None
        feed = region.plant.beside(region.channel.feed if seen else FeedStatus(), now_s)
        region.alarms.trouble(Trouble.FEED_SIGNAL, present=region.plant.differs(now_s))
        return feed

    def _blind(self, region: _Region, now_s: float) -> BlindReason | None:
        if self._frame is None:
            return BlindReason.STARTING
        if region.unfit is not None:
            return BlindReason.UNFIT
        if (unseen := self._unseen(now_s)) is not None:
            return unseen
        if region.sight.reason(now_s) is BlindReason.FILTER:
            return BlindReason.FILTER
        if region.last_s is not None and now_s - region.last_s > self._config.blind_after_s:
            return BlindReason.NO_STREAM
        return None

    def _unseen(self, now_s: float) -> BlindReason | None:
        """Why the newest frame says nothing of the present."""
        if self._frame is None:
            return BlindReason.STARTING
        if now_s - self._frame.received_s > self._config.blind_after_s:
            return BlindReason.NO_STREAM
        if now_s - self._frame.capture_s > self._config.blind_after_s:
            return BlindReason.STALE
        return None


_FUTURE_S = 0.05
"""A frame is received before it is decided on; so much is left to the reading of clocks."""
_MOST_TOLD = 16
_MOST_FAILURES, _FAILS_WITHIN_S = 5, 30.0
"""So many failures of a filter in that time are the prior's."""
_LUMP_COUNTS = (BlindReason.STARTING, BlindReason.FEW_FRAMES)


def _possible(frame: Frame, now_s: float) -> bool:
    """Whether it was captured before it was received, and received before `now_s`."""
    times = (frame.capture_s, frame.received_s)
    return all(isfinite(time_s) for time_s in times) and max(times) <= now_s + _FUTURE_S


def _going_on(pace: Pace, before: Pace) -> Pace:
    """A pace that goes on from another one."""
    pace.restore(before.state())
    return pace


def _unfit(channel: RegionChannel | MouthChannel, quality: PictureQuality) -> BlindReason | None:
    """Why the picture is not fit; a blocked mouth stands as a frozen stream does, but then the belt stands as well."""
    mouth = isinstance(channel, MouthChannel)
    if mouth and quality.reason is BlindReason.FROZEN and channel.feed.state is FeedState.RUNNING:
        return None
    return quality.reason


def _unknown(channel: RegionChannel | MouthChannel) -> BlindReason | None:
    """A mouth that was not yet seen to swallow is not CLEAR, nor is one in which nothing can be told from noise."""
    if not isinstance(channel, MouthChannel):
        return None
    if not channel.known:
        return BlindReason.STARTING
    return None if channel.sees else BlindReason.HIDDEN


def _reason_text(reason: BlindReason | None, region: _Region) -> str | None:
    """The reason in the record of the alarm, with what is known besides."""
    if reason is BlindReason.UNFIT:
        return f"{reason.value}: {region.unfit}"
    return None if reason is None else reason.value
