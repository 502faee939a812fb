"""One region of a camera, step by step: cut, quality, filter, size, and the judgement of its lump alarm.

This is the only definition of that step. Live and in replay, in a proof test, in shadow, and where training
judges what it has learned, the same object runs. What differs between them is an argument: the prior, who
judges the pictures (`PictureJudge`), who observes (`ChannelListener`), and whether a step begins with a frame
or with pictures that were cut already.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import cv2
import numpy as np

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import DetectorConfig, JdtConfig, RoiConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    BlindReason,
    Blockage,
    Decision,
    Detection,
    FeedState,
    FeedStatus,
    Frame,
    NotCounted,
    PictureQuality,
    Transition,
    announce_again,
    step_alarm,
    working_colour,
    working_luma,
)
from lumpwatch.service.detection.channel import Heard, RegionMisfitError
from lumpwatch.service.detection.choices import with_choices
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.feed_watch import FeedWatch
from lumpwatch.service.detection.next_lump import NextLump
from lumpwatch.service.detection.observer import ChannelListener, Unobserved
from lumpwatch.service.detection.picture_judge import EveryPictureFit, PictureJudge
from lumpwatch.service.detection.region import make_region
from lumpwatch.service.detection.sizing import Sizer
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.detection.visible_sizes import SizeWatch
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

MakeDetector = Callable[[DetectorConfig, Roi, Learned | None], Detector]

ANOTHER_LUMP = "another_lump"
"""The reason of an alarm that is announced again for one more lump."""
_ROUNDING = 1e-9


class RegionChannel:
    """Used by one thread. `fit` comes first; times are seconds on one clock and rise from step to step."""

    alarm_class = AlarmClass.LUMP
    found = Decision.LUMP
    belt: str | None = None
    blockage: Blockage | None = None
    unknown: BlindReason | None = None

    def __init__(
        self,
        config: RoiConfig,
        prior: Prior | None,
        *,
        pictures: PictureJudge | None = None,
        listener: ChannelListener | None = None,
        refused: Callable[[LumpwatchError], None] | None = None,
        make: MakeDetector = make_detector,
        feed: bool = False,
    ) -> None:
        """`pictures`: None takes every picture for fit. `feed`: whether to look at what the feed does.

        `refused` is called with the error of a prior that does not fit, and the stated defaults are used in its
        place; without it `fit` raises.
        """
        self.config = config
        self.prior = prior
        """The one in use; None: the stated defaults."""
        self.pictures: PictureJudge = pictures or EveryPictureFit()
        self.alarm = Alarm()
        """Of class lump."""
        self.detection: Detection | None = None
        """Of the last step, in pixels of the picture; None before the first in pictures of this size."""
        self.detector: Detector | None = None
        """None as long as the channel is fit for no picture."""
        self.geometry: Roi | None = None
        """The region as configured: what the picture's quality is measured in; a detector may have a working size of
        its own. None before the first fit."""
        self.size: tuple[int, int] | None = None
        """Width and height of the pictures it is fit for."""
        self.last_s: float | None = None
        """Time of the last step."""
        self._listener: ChannelListener = listener or Unobserved()
        self._refused = refused
        self._make = make
        self._sizer: Sizer | None = None
        self._chosen = config.detector
        self._next = NextLump()
        # Only what is looked for on a belt must move with it; vehicles and people may stand.
        self._rides = isinstance(config.detector, JdtConfig) and config.detector.likelihood.kind == "lump"
        self._looks_at_feed = feed
        self._feed: FeedWatch | None = None
        self._visible: SizeWatch | None = None

    @property
    def feed(self) -> FeedStatus:
        """What the feed does, as far as it is looked at."""
        if self._feed is None:
            return FeedStatus()
        visible = None if self._visible is None else self._visible.sizes
        return replace(self._feed.status, visible=visible)

    def hear(self, heard: Heard) -> None:
        """Nothing: it looks at its belt itself."""

    def unfit(self, quality: PictureQuality) -> BlindReason | None:
        """The quality's own reason."""
        return quality.reason

    def fit(self, width: int, height: int) -> None:
        """Make geometry, sizes and filter for pictures of that size; nothing where they are of that size already.

        Raises RegionMisfitError where the region does not fit them, and LumpwatchError where the prior or the
        detector does not; the channel is then fit for no picture until it can be fitted again.
        """
        if self.size == (width, height):
            return
        self.close()
        self.detection = None
        try:
            self.geometry = make_region(self.config, width, height)
            calibration, certain = self.config.calibration, self.config.alarm.oversize_above
            sizer = None if calibration is None else Sizer(calibration, width, height, certain)
        except (ValueError, LumpwatchError) as error:
            raise RegionMisfitError(str(error)) from error
        detector = self._begun(width, height)
        self.detector, self._sizer, self.size = detector, sizer, (width, height)
        if self._looks_at_feed:
            try:
                self._feed = FeedWatch(self.config.feed, calibration, self.geometry, (width, height))
            except ValueError:  # too small a region to tell: its feed stays unknown
                self._feed = None
            if calibration is not None and isinstance(detector, JdtDetector):
                self._visible = SizeWatch(self.config.feed, calibration, (width, height))

    def step(
        self, frame: Frame, *, now_s: float | None = None, may_learn: bool = True, may_clear: bool = True
    ) -> Transition | None:
        """One frame of the fitted size: cut the region where it lies now, filter, and step the alarm.

        Returns what became of the alarm, which is decided at `now_s`; None: at the capture. `may_learn`: whether the
        picture may teach a background model, if it is fit; `may_clear`: whether it may clear the alarm. Raises
        whatever is wrong with filter or frame; the alarm and the detection are then as before.
        """
        began, dt = perf_counter(), self._advance(frame.capture_s)
        # The detector thinks where the camera looked at first; only what goes in and out is moved.
        place, offset = self.pictures.placed(self.config.id, self._fitted().roi, frame.width, frame.height)
        gray = working_luma(frame, place)
        colour = working_colour(frame, place) if self.config.detector.needs_colour else None
        cut_s = perf_counter() - began
        transition = self._filter(
            gray,
            colour,
            dt,
            frame.capture_s,
            now_s=now_s,
            offset_px=offset,
            may_learn=may_learn,
            may_clear=may_clear,
        )
        self._listener.stage("cut", self.config.id, cut_s)
        return transition

    def step_working(self, gray: Image, colour: Image | None, time_s: float) -> Transition | None:
        """The same on a working picture (h, w) that was cut already, with colour (h, w, 3) where it is needed."""
        return self._filter(
            gray, colour, self._advance(time_s), time_s, now_s=None, offset_px=(0, 0), may_learn=True
        )

    def begin_anew(self) -> None:
        """Forget what the filter knows of the past, after it has failed; alarm and sizes stay."""
        self._fitted()
        assert self.size is not None
        self.detector = self._made(self.prior.learned if self.prior else None, *self.size)

    def use(self, prior: Prior | None) -> None:
        """Filter on with another prior (None: the stated defaults).

        Raises LumpwatchError where it does not fit; all is then as before.
        """
        if self.detector is not None and self.size is not None:
            if prior is not None:
                prior.check_fits(self.config, *self.size)
            learned = prior.learned if prior else None
            if with_choices(self.config, learned).detector == self._chosen:
                self.detector.use(learned)
            else:  # another working size or background model: nothing of the old one is of use
                self.detector = self._made(learned, *self.size)
        self.prior = prior

    def close(self) -> None:
        """Let go of the filter; the channel is fit for no picture any more."""
        self.detector, self._sizer, self.size = None, None, None
        self._feed = self._visible = None

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, but the prior's content."""
        return Snapshot(
            last_capture_s=self.last_s,
            size=self.size,
            filter=None if self.detector is None else self.detector.state(),
            sizes={} if self._sizer is None else self._sizer.state(),
            alarms={AlarmClass.LUMP: self.alarm},
            prior=self.prior,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from there; the channel must have been made with the snapshot's prior.

        Raises StateMismatchError, and what `fit` raises.
        """
        self.alarm = snapshot.alarms.get(AlarmClass.LUMP, self.alarm)
        self.last_s, self.size = snapshot.last_capture_s, None
        if snapshot.size is None:
            return
        self.fit(*snapshot.size)
        if snapshot.filter is not None:
            self._fitted().restore(snapshot.filter)
        if self._sizer is not None:
            self._sizer.restore(snapshot.sizes)

    def _made(self, learned: Learned | None, width: int, height: int) -> Detector:
        """A new detector for pictures of that size, as training chose it where the configuration leaves it open."""
        chosen = with_choices(self.config, learned)
        geometry = self.geometry if chosen is self.config else make_region(chosen, width, height)
        assert geometry is not None
        detector = self._make(chosen.detector, geometry, learned)
        self._chosen = chosen.detector
        return detector

    def _begun(self, width: int, height: int) -> Detector:
        """A detector with the prior, or with the defaults where that is refused and `refused` was given."""
        if self.prior is not None:
            try:
                self.prior.check_fits(self.config, width, height)
                return self._made(self.prior.learned, width, height)
            except LumpwatchError as error:
                if self._refused is None:
                    raise
                self._refused(error)
        detector = self._made(None, width, height)
        self.prior = None  # not before: where the defaults do not do either, it may fit the next size
        return detector

    def _fitted(self) -> Detector:
        if self.detector is None:
            raise RegionMisfitError("the region is fit for no picture yet")
        return self.detector

    def _advance(self, time_s: float) -> float:
        """Seconds since the last step."""
        last_s, self.last_s = self.last_s, time_s
        return DEFAULT_INTERVAL_S if last_s is None else time_s - last_s

    def _filter(
        self,
        gray: Image,
        colour: Image | None,
        dt: float,
        time_s: float,
        *,
        now_s: float | None,
        offset_px: tuple[int, int],
        may_learn: bool,
        may_clear: bool = True,
    ) -> Transition | None:
        name, detector = self.config.id, self._fitted()
        began = perf_counter()
        self.pictures.observe(name, self._as_configured(gray), time_s)
        observed = perf_counter()
        if self._feed is not None:
            self._feed.step(self._as_configured(gray), time_s)
        watched = perf_counter()
        quality = self.pictures.current(name)
        # A background model must not learn what covers the lens.
        detector.learns = may_learn and quality.reason is None and not quality.suspect
        found = detector.step(gray, colour, dt)
        if self._rides:
            found = found.without(self.pictures.strangers(name, found, time_s), NotCounted.STANDS)
        self._watch_sizes(detector, quality, time_s)
        if self._sizer is not None:
            found = self._sizer.measure(found, time_s)
        if not isinstance(self.config.detector, JdtConfig):
            # A tracker remembers how large an object is that enters or leaves; shown is what can be seen of it.
            place = detector.roi
            found = found.within(place.x, place.y, place.x + place.width, place.y + place.height)
        _check(found)
        self.detection = found.moved(*offset_px)
        self._listener.stage("quality", name, observed - began)
        self._listener.stage("feed", name, watched - observed)
        self._listener.stage("filter", name, perf_counter() - watched)
        self.pictures.filtered(name, self.detection, time_s)
        evidence = self._evidence(found.alarming, may_clear)
        decided_s = time_s if now_s is None else now_s
        self.alarm, transition = step_alarm(
            self.alarm, self.config.alarm, evidence, decided_s, observed_s=time_s
        )
        return self._next_lump(self.detection, transition, time_s, decided_s)

    def _next_lump(
        self, found: Detection, transition: Transition | None, time_s: float, decided_s: float
    ) -> Transition | None:
        """An alarm that stands hides no further lump: it is announced again."""
        if not self.alarm.active:
            self._next.cleared()
        elif transition is not None:
            self._next.raised(found, time_s)
        elif not self.pictures.current(self.config.id).held_off:
            rules = self.config.alarm
            if self._next.comes(found, time_s, rules.raise_above, rules.oversize_above):
                self.alarm, transition = announce_again(self.alarm, decided_s)
                return None if transition is None else replace(transition, reason=ANOTHER_LUMP)
        return transition

    def _watch_sizes(self, detector: Detector, quality: PictureQuality, time_s: float) -> None:
        """What stands would be counted again and again, and what is not seen well is no stone."""
        if self._visible is None or self._feed is None or not isinstance(detector, JdtDetector):
            return
        runs = self._feed.status.state is FeedState.RUNNING
        if runs and quality.reason is None and not quality.suspect and detector.bodies is not None:
            self._visible.step(detector.bodies, detector.roi, time_s)

    def _as_configured(self, gray: Image) -> Image:
        """The working picture in the configured working size, for measures that are compared with a reference."""
        assert self.geometry is not None
        if gray.shape == self.geometry.shape:
            return gray
        height, width = self.geometry.shape
        return np.asarray(cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA), np.uint8)

    def _evidence(self, alarming: float, may_clear: bool) -> float:
        """What the lump alarm may judge: a picture that is not fit clears no alarm, nor do too few of them.

        It may still raise one, except in the hold-off after the exposure has jumped.
        """
        quality, rules = self.pictures.current(self.config.id), self.config.alarm
        if quality.reason is None and not quality.suspect and (may_clear or not self.alarm.active):
            return alarming
        if self.alarm.active:
            return max(alarming, rules.clear_below)
        return min(alarming, rules.raise_above) if quality.held_off else alarming


def _check(found: Detection) -> None:
    """Raises ValueError: what is no probability would pass for CLEAR."""
    for value in (found.existence, found.alarming):
        if not -_ROUNDING <= value <= 1.0 + _ROUNDING:
            raise ValueError(f"existence {value} is not a probability")
