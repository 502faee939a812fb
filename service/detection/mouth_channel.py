"""One region that watches a mouth, step by step: cut, quality, what stands in it, and whether that blocks it.

It stands beside `RegionChannel` and answers to the same calls, but it looks for no lumps: it has no filter, no prior
and no lump alarm. What the feed does and which lumps come is told by the region of the belt (`hear`).
"""

from __future__ import annotations

from time import perf_counter

import cv2
import numpy as np

from lumpwatch.models.mouth import Arrival, Limits, MouthWatch
from lumpwatch.models.roi import Roi, make_roi
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import (
    Alarm,
    Blockage,
    BlockedReason,
    Detection,
    FeedState,
    FeedStatus,
    Frame,
    working_luma,
)
from lumpwatch.service.detection.detectors.base import FilterState, StateMismatchError
from lumpwatch.service.detection.observer import ChannelListener, Unobserved
from lumpwatch.service.detection.region_channel import EveryPictureFit, PictureJudge, RegionMisfitError
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

_NEAR = 0.75
"""A lump is before the mouth where it is nearer to it than so many of its own longer sides."""
_LIKELY = 0.5
_NOTHING = Detection(existence=0.0, objects=())


class MouthChannel:
    """Used by one thread. `fit` comes first; times are seconds on one clock and rise from step to step."""

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
        """Of class lump: it stays as it is."""
        self.prior: Prior | None = None
        """None, always."""
        self.detector = None
        """None, always."""
        self.detection: Detection | None = None
        """Nothing, once a frame was judged."""
        self.geometry: Roi | None = None
        self.size: tuple[int, int] | None = None
        self.last_s: float | None = None
        self.feed = FeedStatus()
        """What the belt's region says of the feed."""
        self._runs = True
        self._arrivals: tuple[Arrival, ...] = ()
        self._watch: MouthWatch | None = None
        self._listener: ChannelListener = listener or Unobserved()

    @property
    def known(self) -> bool:
        """Whether the mouth itself is known."""
        return self._watch is not None and self._watch.state.known

    @property
    def sees(self) -> bool:
        """Whether the mouth shows more than noise."""
        return self._watch is None or self._watch.state.sees

    @property
    def blockage(self) -> Blockage | None:
        """What the mouth looks like; None before anything was seen."""
        if self._watch is None or self.last_s is None:
            return None
        state, reason = self._watch.state, None
        if state.stuck and state.stood_s > 0.0:
            reason = BlockedReason.LUMP if state.lump else BlockedReason.STANDING
        return Blockage(standing=state.share, stood_s=state.stood_s, reason=reason)

    def blocked(self, *, active: bool, may_clear: bool) -> bool:
        """Whether the condition of the alarm holds, the delay applied; `active`: whether it holds already.

        Then only what is seen ends it: not a picture that is unfit, nor a mouth that is not known yet.
        """
        if self._watch is None:
            return active
        state = self._watch.state
        if active:
            return state.stuck or not state.known or not may_clear or not self._fit_now()
        return state.stuck and state.stood_s >= self.config.alarm.blocked.on_delay_s - 1e-6

    def hear(self, feed: FeedStatus, plant_runs: bool | None, lumps: Detection | None) -> None:
        """What the feed does before the next frame, what the plant says of it, and what is followed on the belt.

        A feed that is not known counts as running: a blockage must not go unseen for that.
        """
        self.feed = feed
        self._runs = feed.state is FeedState.RUNNING or (
            feed.state is FeedState.UNKNOWN and plant_runs is not False
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
    ) -> None:
        """One frame of the fitted size: cut the mouth where it lies now, and see what stands in it.

        Without `may_learn` the picture is of the past and changes nothing. `now_s` and `may_clear` are not looked at:
        the alarm is stepped by `blocked`. Raises whatever is wrong with the frame.
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
        watch.step(gray, time_s, runs=self._runs, fit=fit, arrivals=self._arrivals)
        self.last_s, self.detection = time_s, _NOTHING
        self.pictures.filtered(name, _NOTHING, time_s)
        self._listener.stage("cut", name, cut - began)
        self._listener.stage("quality", name, observed - cut)
        self._listener.stage("mouth", name, perf_counter() - observed)

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
        state = None if self._watch is None else FilterState(*self._watch.snapshot())
        return Snapshot(
            last_capture_s=self.last_s, size=self.size, filter=state, sizes={}, alarms={}, prior=None
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from there. Raises StateMismatchError, and what `fit` raises."""
        self.last_s, self.size = snapshot.last_capture_s, None
        if snapshot.size is None:
            return
        self.fit(*snapshot.size)
        if snapshot.filter is None:
            return
        try:
            self._fitted()[0].restore(snapshot.filter.plain, snapshot.filter.arrays)
        except (KeyError, TypeError, ValueError) as error:
            raise StateMismatchError(f"the stored state is not one of this mouth ({error})") from error

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
