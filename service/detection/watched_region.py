"""One region of a camera: its channel, what it can be believed, its alarms, and its decision."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

from lumpwatch.service.belt import make_pace, ride_s
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    AlarmChange,
    BlindReason,
    Decision,
    FeedStatus,
    Frame,
    Pace,
    RoiResult,
    Trouble,
)
from lumpwatch.service.detection.channel import Channel, Heard
from lumpwatch.service.detection.observer import PipelineObserver
from lumpwatch.service.detection.picture_judge import PictureJudge
from lumpwatch.service.detection.plant_signal import PlantSignal
from lumpwatch.service.detection.prior_in_use import PriorInUse
from lumpwatch.service.detection.region_alarms import RegionAlarms
from lumpwatch.service.detection.sight import Sight
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

log = logging.getLogger(__name__)

_MOST_TOLD = 16
_LUMP_COUNTS = (BlindReason.STARTING, BlindReason.FEW_FRAMES)


@dataclass(frozen=True, slots=True)
class Newest:
    """The newest frame of a camera."""

    frame: Frame | None = None
    """None before the first."""
    taken_s: float | None = None
    """When it was taken up, on the clock of `now_s`."""

    def unseen(self, now_s: float, after_s: float) -> BlindReason | None:
        """Why it says nothing of the present: it is older than `after_s`, or there is none."""
        if self.frame is None:
            return BlindReason.STARTING
        if now_s - self.frame.received_s > after_s:
            return BlindReason.NO_STREAM
        if now_s - self.frame.capture_s > after_s:
            return BlindReason.STALE
        return None


class WatchedRegion:
    """Used by one thread; `now_s` rises from call to call."""

    def __init__(
        self,
        camera: CameraConfig,
        channel: Channel,
        pictures: PictureJudge,
        before: Prior | None,
        observer: PipelineObserver,
    ) -> None:
        """`pictures` judges its pictures; `before`: the prior before the one in use."""
        self.channel = channel
        self.alarms = RegionAlarms(channel)
        self.sight = Sight(camera.sight, camera.blind_after_s)
        self.plant = PlantSignal(channel.config.feed)
        self.prior = PriorInUse(f"{camera.id}/{channel.config.id}", channel, before, observer)
        self.unfit: str | None = None
        """Why it does not fit the picture."""
        self.pace = Pace()
        """Which frames it is decided on."""
        self.due = True
        """Whether the present one is among them."""
        self.result: RoiResult | None = None
        """Of the newest frame; None before the first, and where it failed."""
        self._camera, self._pictures, self._observer = camera, pictures, observer
        self._last_s: float | None = None
        """When it last judged a frame, on the clock of `now_s`."""
        self._told: set[str] = set()
        """Failures of the filter whose traceback is in the log."""

    def fit(self, width: int, height: int) -> None:
        """Fit it to pictures of that size; where it does not fit them it is blind, and says so."""
        channel = self.channel
        try:
            if channel.size != (width, height):
                channel.fit(width, height)
                self.sight.begin()
            self.sight.ride(ride_s(channel.config, width, height))
        except Exception as error:  # whatever it is: it must not take the other regions with it
            self.unfit = str(error) or type(error).__name__
            log.error(  # noqa: TRY400 - the line says it, unless it is a surprise
                "camera %s, roi %s: unfit for pictures of %d x %d, the region is blind: %s",
                self._camera.id,
                channel.config.id,
                width,
                height,
                self.unfit,
                exc_info=None if isinstance(error, LumpwatchError) else error,
            )
        else:
            self.unfit = None

    def fit_pace(self, width: int, height: int) -> None:
        """How often to decide, in pictures of that size."""
        wanted = make_pace(self.channel.config, self._camera.sight, width, height)
        wanted.restore(self.pace.state())
        self.pace = wanted

    def step(self, newest: Newest, now_s: float, others: Mapping[str, WatchedRegion]) -> None:
        """Judge the newest frame, if the region is due and fits it.

        `others`: the regions of the camera; the one that it must hear of was stepped before. What fails is not raised:
        the region goes blind and begins anew, and leaves the others alone.
        """
        frame = newest.frame
        if frame is None or self.unfit is not None or not self.due:
            self.result = self.decide(newest, now_s)
            return
        may_learn = newest.unseen(now_s, self._camera.blind_after_s) is None
        may_clear = may_learn and self.sight.reason(frame.capture_s) is None
        try:
            self._hear(others, now_s)
            transition = self.channel.step(frame, now_s=now_s, may_learn=may_learn, may_clear=may_clear)
        except Exception as error:
            self.failed(error, newest)
            self.result = self.decide(newest, now_s)
            return
        self.sight.judged(frame.capture_s)
        self._last_s = now_s
        self.result = self.decide(newest, now_s, self.alarms.stepped(transition), decided=True)

    def failed(self, error: Exception, newest: Newest) -> None:
        """The filter failed: it begins anew, and the region is BLIND until it has looked for long enough again."""
        self._observer.dropped("failed")
        self.sight.begin(failed=True)
        what = f"{type(error).__name__}: {error}"
        if what not in self._told and len(self._told) < _MOST_TOLD:
            self._told.add(what)
            log.error(
                "camera %s, roi %s: the filter failed and begins anew; told once, further failures are counted",
                self._camera.id,
                self.channel.config.id,
                exc_info=error,
            )
        if self.prior.failed(newest.taken_s):
            self.alarms.trouble(Trouble.PRIOR, present=True)
        if self.unfit is None:
            try:
                self.channel.begin_anew()
            except Exception:
                self.unfit = what
                log.exception("%s/%s: the filter cannot begin anew", self._camera.id, self.channel.config.id)

    def decide(
        self, newest: Newest, now_s: float, changes: tuple[AlarmChange, ...] = (), *, decided: bool = False
    ) -> RoiResult:
        """What is said of the region at `now_s`; `decided`: whether the newest frame was judged for it."""
        channel = self.channel
        quality = self._pictures.current(channel.config.id)
        reason = self._blind(newest, now_s) or channel.unfit(quality)
        short = None if reason is not None else self.sight.reason(now_s) or channel.unknown
        feed = self._feed(now_s, seen=reason is None and short is None)
        changes += self.alarms.tick(self._reason_text(reason or short), now_s)
        # What was found in a fit picture counts however few were looked at; that nothing was found does not.
        alarming = channel.alarm.active
        if not (alarming and self._last_s is not None and short in _LUMP_COUNTS):
            reason = reason or short
        clear_or_found = channel.found if alarming else Decision.CLEAR
        return RoiResult(
            roi=channel.config.id,
            frame=newest.frame,
            decision=clear_or_found if reason is None else Decision.BLIND,
            reason=reason,
            detection=channel.detection,
            existence=channel.detection.existence if channel.detection else 0.0,
            alarms=self.alarms.now(),
            prior=channel.prior.version if channel.prior else 0,
            decided=decided,
            changes=changes,
            taken_s=newest.taken_s,
            quality=quality,
            feed=feed,
            blockage=channel.blockage,
        )

    def snapshot(self, camera_pace: Pace) -> Snapshot:
        """All that the next step depends on."""
        return replace(
            self.channel.snapshot(),
            alarms=self.alarms.now(),
            sight=self.sight.state(),
            pace=self.pace.state(),
            camera_pace=camera_pace.state(),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from there; raises StateMismatchError, and LumpwatchError where it does not fit the picture."""
        self.alarms.restore(snapshot.alarms)
        self.channel.restore(snapshot)
        self.sight.restore(snapshot.sight)
        self.pace.restore(snapshot.pace)

    def _hear(self, others: Mapping[str, WatchedRegion], now_s: float) -> None:
        """What the plant and the region of the belt say of this frame."""
        says, belt = self.plant.runs(now_s), others.get(self.channel.belt or "")
        if belt is None or belt.result is None:
            self.channel.hear(Heard(plant_runs=says))
            return
        seen = None if belt.result.decision is Decision.BLIND else belt.result.feed
        said = belt.plant.runs(now_s) if says is None else says
        feed = replace(seen or FeedStatus(), plant=None, agrees=None, visible=None)
        self.channel.hear(Heard(feed, said, belt.result.detection))

    def _feed(self, now_s: float, *, seen: bool) -> FeedStatus | None:
        """What the feed does, beside what the plant says."""
        if not self.channel.config.feed.enabled:
            return None
        feed = self.plant.beside(self.channel.feed if seen else FeedStatus(), now_s)
        self.alarms.trouble(Trouble.FEED_SIGNAL, present=self.plant.differs(now_s))
        return feed

    def _blind(self, newest: Newest, now_s: float) -> BlindReason | None:
        """Why nothing can be said, whatever the picture shows."""
        after_s = self._camera.blind_after_s
        if newest.frame is None:
            return BlindReason.STARTING
        if self.unfit is not None:
            return BlindReason.UNFIT
        if (unseen := newest.unseen(now_s, after_s)) is not None:
            return unseen
        if self.sight.reason(now_s) is BlindReason.FILTER:
            return BlindReason.FILTER
        if self._last_s is not None and now_s - self._last_s > after_s:
            return BlindReason.NO_STREAM
        return None

    def _reason_text(self, reason: BlindReason | None) -> str | None:
        """The reason in the record of the alarm, with what is known besides."""
        if reason is BlindReason.UNFIT:
            return f"{reason.value}: {self.unfit}"
        return None if reason is None else reason.value
