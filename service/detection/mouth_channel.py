"""One region that watches a mouth, step by step: cut, quality, what stands in it, and whether that blocks it.

It looks for no lumps: it has no filter, no prior and no lump alarm. What the feed does and which lumps come is told by
the region of the belt (`hear`).
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import cv2
import numpy as np

from lumpwatch.models.mouth import Arrival, Limits, MouthWatch
from lumpwatch.models.roi import Roi, make_roi
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    BlindReason,
    Blockage,
    BlockedReason,
    Decision,
    Detection,
    FeedState,
    FeedStatus,
    Frame,
    PictureQuality,
    Transition,
    step_alarm,
    working_luma,
)
from lumpwatch.service.detection.channel import Heard, RegionMisfitError
from lumpwatch.service.detection.detectors.base import Detector, FilterState, StateMismatchError
from lumpwatch.service.detection.observer import ChannelListener, Unobserved
from lumpwatch.service.detection.picture_judge import EveryPictureFit, PictureJudge
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

_NEAR = 0.75
"""A lump is before the mouth where it is nearer to it than so many of its own longer sides."""
_LIKELY = 0.5
_REACHES_S = 30.0
"""After an empty belt the first ore is at the mouth once something moves there, or after so long at the latest."""
_STILL_S = 3.0
"""By then what moved in the mouth before is no longer seen to move."""
_NOTHING = Detection(existence=0.0, objects=())


class MouthChannel:
    """Used by one thread. `fit` comes first; times are seconds on one clock and rise from step to step."""

    alarm_class = AlarmClass.BLOCKED
    found = Decision.BLOCKED

    def __init__(
        self,
        config: RoiConfig,
        *,
        pictures: PictureJudge | None = None,
        listener: ChannelListener | None = None,
    ) -> None:
        """`pictures`: None takes every picture for fit."""
        self.config = config
        self.pictures: PictureJudge = pictures or EveryPictureFit()
        self.alarm = Alarm()
        """Of class blocked."""
        self.prior: Prior | None = None
        """None, always."""
        self.detector: Detector | None = None
        """None, always."""
        self.detection: Detection | None = None
        """Nothing, once a frame was judged."""
        self.geometry: Roi | None = None
        self.size: tuple[int, int] | None = None
        self.last_s: float | None = None
        self.feed = FeedStatus()
        """What the belt's region says of the feed."""
        # The delay counts while the feed runs only, so it is applied here.
        self._rules = config.alarm.blocked.model_copy(update={"on_delay_s": 0.0})
        self._runs = True
        self._was_empty = False
        self._fed_s: float | None = None
        self._arrivals: tuple[Arrival, ...] = ()
        self._watch: MouthWatch | None = None
        self._listener: ChannelListener = listener or Unobserved()

    @property
    def belt(self) -> str | None:
        """The region of the belt before the mouth."""
        return self.config.mouth.belt

    @property
    def unknown(self) -> BlindReason | None:
        """STARTING until it was seen to swallow; HIDDEN where nothing can be told from noise."""
        if self._watch is None or not self._watch.state.known:
            return BlindReason.STARTING
        return None if self._watch.state.sees else BlindReason.HIDDEN

    @property
    def blockage(self) -> Blockage | None:
        """What the mouth looks like; None before anything was seen."""
        if self._watch is None or self.last_s is None:
            return None
        state, reason = self._watch.state, None
        if state.stuck and state.stood_s > 0.0:
            reason = BlockedReason.LUMP if state.lump else BlockedReason.STANDING
        return Blockage(standing=state.share, stood_s=state.stood_s, reason=reason)

    def unfit(self, quality: PictureQuality) -> BlindReason | None:
        """A blocked mouth stands as a frozen stream does, but then the belt stands as well."""
        if quality.reason is BlindReason.FROZEN and self.feed.state is FeedState.RUNNING:
            return None
        return quality.reason

    def _blocked(self, may_clear: bool) -> bool:
        """Whether the condition of the alarm holds, the delay applied.

        Once it does, only what is seen ends it: not a picture that is unfit, nor a mouth that is not known yet.
        """
        if self._watch is None:
            return self.alarm.active
        state = self._watch.state
        if self.alarm.active:
            return state.stuck or not state.known or not may_clear or not self._fit_now()
        return state.stuck and state.stood_s >= self.config.alarm.blocked.on_delay_s - 1e-6

    def hear(self, heard: Heard) -> None:
        """A feed that is not known counts as running: a blockage must not go unseen for that."""
        self.feed, lumps = heard.feed, heard.lumps
        self._was_empty |= heard.feed.state is FeedState.EMPTY
        self._runs = heard.feed.state is FeedState.RUNNING or (
            heard.feed.state is FeedState.UNKNOWN and heard.plant_runs is not False
        )
        self._arrivals = () if lumps is None or not self.config.mouth.lumps else self._before(lumps)

    def fit(self, width: int, height: int) -> None:
        """Make the geometry for pictures of that size; nothing where they are of that size already.

        Raises RegionMisfitError where the region does not fit them.
        """
        if self.size == (width, height):
            return
        self.close()
        self.detection = None
        mouth = self.config.mouth
        try:
            self.geometry = make_roi(self.config.polygon, width, height, self.config.working_size_px)
            self._watch = MouthWatch(
                self.geometry.mask, Limits(mouth.blocked_above, mouth.free_below, mouth.learn_s)
            )
        except ValueError as error:
            raise RegionMisfitError(str(error)) from error
        self.size = (width, height)

    def step(
        self, frame: Frame, *, now_s: float | None = None, may_learn: bool = True, may_clear: bool = True
    ) -> Transition | None:
        """One frame of the fitted size: cut the mouth where it lies now, see what stands in it, and step the alarm.

        Without `may_learn` the picture is of the past and changes nothing. Raises whatever is wrong with the frame.
        """
        began = perf_counter()
        watch, geometry = self._fitted()
        name, time_s = self.config.id, frame.capture_s
        place, _ = self.pictures.placed(name, geometry, frame.width, frame.height)
        gray = working_luma(frame, place)
        cut = perf_counter()
        self.pictures.observe(name, gray, time_s)
        observed = perf_counter()
        fit = may_learn and self._fit_now()
        watch.step(gray, time_s, runs=self._runs and self._reached(time_s), fit=fit, arrivals=self._arrivals)
        self.last_s, self.detection = time_s, _NOTHING
        self.pictures.filtered(name, _NOTHING, time_s)
        self._listener.stage("cut", name, cut - began)
        self._listener.stage("quality", name, observed - cut)
        self._listener.stage("mouth", name, perf_counter() - observed)
        decided_s = time_s if now_s is None else now_s
        holds = float(self._blocked(may_clear))
        self.alarm, transition = step_alarm(self.alarm, self._rules, holds, decided_s, observed_s=time_s)
        found = self.blockage
        if transition is None or found is None or found.reason is None:
            return transition
        return replace(transition, reason=found.reason.value)

    def begin_anew(self) -> None:
        """Forget what was seen, after it has failed: the mouth must be learned again."""
        size, self.size = self.size, None
        assert size is not None
        self.fit(*size)

    def use(self, prior: Prior | None) -> None:
        """Raises LumpwatchError for any prior: a mouth has none."""
        if prior is not None:
            raise LumpwatchError("the region watches a mouth, which has no prior")

    def close(self) -> None:
        """The channel is fit for no picture any more."""
        self.size, self._watch = None, None

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, but what is heard of the belt."""
        kept = None
        if self._watch is not None:
            plain, arrays = self._watch.snapshot()
            kept = FilterState({**plain, "was_empty": self._was_empty, "fed_s": self._fed_s}, arrays)
        return Snapshot(
            last_capture_s=self.last_s,
            size=self.size,
            filter=kept,
            sizes={},
            alarms={AlarmClass.BLOCKED: self.alarm},
            prior=None,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from there. Raises StateMismatchError, and what `fit` raises."""
        self.alarm = snapshot.alarms.get(AlarmClass.BLOCKED, self.alarm)
        self.last_s, self.size = snapshot.last_capture_s, None
        if snapshot.size is None:
            return
        self.fit(*snapshot.size)
        if snapshot.filter is None:
            return
        try:
            plain = snapshot.filter.plain
            self._fitted()[0].restore(plain, snapshot.filter.arrays)
            self._was_empty, self._fed_s = bool(plain.get("was_empty")), plain.get("fed_s")
        except (KeyError, TypeError, ValueError) as error:
            raise StateMismatchError(f"the stored state is not one of this mouth ({error})") from error

    def _reached(self, time_s: float) -> bool:
        """Whether ore is at the mouth again: after the belt was empty it runs for a while with nothing at its end, and
        what an empty mouth shows then is its walls.
        """
        if not self._was_empty or not self._runs:
            self._fed_s = None
            return not self._was_empty
        self._fed_s = time_s if self._fed_s is None else self._fed_s
        fed_s = time_s - self._fed_s
        moves = self._watch is not None and self._watch.state.swallows
        self._was_empty = not ((moves and fed_s >= _STILL_S) or fed_s >= _REACHES_S)
        return not self._was_empty

    def _fitted(self) -> tuple[MouthWatch, Roi]:
        if self._watch is None or self.geometry is None:
            raise RegionMisfitError("the region is fit for no picture yet")
        return self._watch, self.geometry

    def _fit_now(self) -> bool:
        """Whether the newest picture is fit to tell what stands."""
        quality = self.pictures.current(self.config.id)
        return not (quality.suspect or quality.held_off) and quality.reason is None

    def _before(self, lumps: Detection) -> tuple[Arrival, ...]:
        """Those that are about to come into the mouth."""
        if self.geometry is None:
            return ()
        corners = self.geometry.corners.astype(np.float32)
        area = max(float(cv2.contourArea(corners)), 1.0)
        return tuple(
            Arrival(found.id, min(found.w * found.h / area, 1.0))
            for found in lumps.counted
            if found.existence > _LIKELY
            and cv2.pointPolygonTest(corners, (found.x + found.w / 2, found.y + found.h / 2), True)
            > -_NEAR * max(found.w, found.h)
        )
