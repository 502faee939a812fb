"""The monitor's part of a proof test: a second chain of the same make, fed with the frames that carry the lump.

The chain that watches the belt goes on beside it, undisturbed: it gets its own frames, and what it says
only tells whether the test can be judged.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial

import numpy as np

from lumpwatch.service.belt import make_plane
from lumpwatch.service.bus import Bus, BusClosed, Keys
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import (
    AlarmClass,
    Clocks,
    Decision,
    FeedState,
    LumpCut,
    RoiResult,
    StreamClock,
    utc,
)
from lumpwatch.service.detection import CameraPipeline, Snapshot, make_profile, make_region
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.monitor.inbox import on_this_clock
from lumpwatch.service.monitor.proof.lumps import as_message, next_lump, sides_on_belt
from lumpwatch.service.monitor.proof.mouth import MouthPassage, way_into
from lumpwatch.service.monitor.proof.passage import Ended, Passage
from lumpwatch.service.monitor.proof.path import Way, greys_of, make_way, over_profile, reached_lip
from lumpwatch.service.protocol import (
    SHOWS_DRAWN,
    SHOWS_LABELLED,
    BlendPlan,
    Outcome,
    ProofReason,
    ProofResult,
    alarm_event,
)
from lumpwatch.service.storage import Prior

log = logging.getLogger(__name__)

_AFTER_S = 1.0
_TAKE_S = 0.25
_DRAW_S = 10.0
"""For the camera's process to draw the lump before the first frame."""
_STOP_S = 1.0
"""When the daemon stops, all its processes are notified; so much later the last of them knows."""
_BROKEN = (ProofReason.NO_CAMERA, ProofReason.NO_FRAMES, ProofReason.ERROR)
"""Failures that look the same where the other processes end because the daemon does."""


@dataclass(frozen=True, slots=True)
class Site:
    """What the test may know of the chain that watches the belt."""

    size: Callable[[], tuple[int, int] | None]
    """Width and height of the pictures."""
    prior: Callable[[str], Prior | None]
    decision: Callable[[str], Decision]
    stopped: Callable[[float], bool]
    """Whether the daemon asks to stop within so many seconds."""
    feed: Callable[[str], FeedState] = lambda _: FeedState.UNKNOWN
    """What the feed of a ROI does."""
    snapshot: Callable[[str], Snapshot | None] = lambda _: None
    """What the chain knows of a ROI."""


class ProofTest:
    """Tests the ROIs of one camera, one at a time; `run` blocks its thread until the lump has passed."""

    def __init__(
        self,
        site: str,
        camera: CameraConfig,
        bus: Bus,
        watched: Site,
        lumps: Callable[[str, int], Sequence[LumpCut]] = lambda *_: (),
    ) -> None:
        """`lumps` gives the labelled lumps that came with a version of a ROI's prior."""
        self._site = site
        self._camera = camera
        self._bus = bus
        self._site_state = watched
        self._lumps = lumps
        self._keys = Keys(site)
        self._alarms = {
            roi.id: bus.alarm_publisher(self._keys.test(camera.id, roi.id)) for roi in camera.rois
        }
        self._sequence = 0

    def run(self, roi_id: str, actor: str, last: ProofResult | None = None) -> ProofResult:
        """Test one ROI, whose last judged test ended so; INCONCLUSIVE where the daemon stops meanwhile.

        Raises KeyError for another ROI.
        """
        roi = self._camera.roi(roi_id)
        prior = self._site_state.prior(roi_id)
        cut = self._lump(roi, prior, last)
        result = ProofResult(
            site=self._site,
            camera=self._camera.id,
            roi=roi_id,
            time=utc(time.time()),
            outcome=Outcome.FAILED,
            prior=prior.version if prior else 0,
            actor=actor,
            lump="" if cut is None else cut.name,
            shows=SHOWS_DRAWN if cut is None else SHOWS_LABELLED,
        )
        passage = MouthPassage(roi) if roi.watches_mouth else Passage(roi)
        try:
            self._pass(roi, prior, cut, passage)
        except Ended as end:
            passage.outcome, passage.reason = end.outcome, end.reason
        except BusClosed:
            passage.outcome, passage.reason = Outcome.INCONCLUSIVE, ProofReason.STOPPED
        except (LumpwatchError, ValueError) as error:
            log.error("%s/%s: proof test: %s", self._camera.id, roi_id, error)  # noqa: TRY400 - it says it all
            passage.outcome, passage.reason = Outcome.FAILED, ProofReason.ERROR
        if passage.reason in _BROKEN and self._site_state.stopped(_STOP_S):
            passage.outcome, passage.reason = Outcome.INCONCLUSIVE, ProofReason.STOPPED
        return result.model_copy(
            update={
                "time": _now(),
                "outcome": passage.outcome,
                "reason": passage.reason,
                "warning_s": None if passage.warning_s is None else round(passage.warning_s, 2),
                "existence": round(passage.existence, 6),
            }
        )

    def _pass(self, roi: RoiConfig, prior: Prior | None, cut: LumpCut | None, passage: Passage) -> None:
        """Let the lump pass through the test chain."""
        self._check(roi.id)
        feed = self._site_state.feed(roi.id)
        if feed is FeedState.EMPTY or (roi.watches_mouth and feed is FeedState.STOPPED):
            # A lump on a bare belt is easier to find than one among ore: a pass would show too little. So it would of
            # a mouth in which everything stands.
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.EMPTY)
        size = self._site_state.size()
        if size is None:
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.BLIND)
        way = self._way(roi, prior, cut, size)
        lasts_s = way.path[-1].t_s + _AFTER_S
        plan = BlendPlan(
            roi=roi.id,
            path=way.path,
            lasts_s=lasts_s,
            greys=greys_of(prior.learned if prior else None),
            lump=None if cut is None else as_message(cut),
            seed=int(time.time()) % 2**31,
        )
        alone = self._camera.model_copy(update={"rois": (_alone(roi),)})
        pipeline = CameraPipeline(alone, {roi.id: prior})
        if roi.watches_mouth and (known := self._site_state.snapshot(roi.id)) is not None:
            pipeline.restore(roi.id, known)  # it would have to learn the mouth first
        inbox = self._bus.frame_inbox(self._keys.test_frame(self._camera.id))
        try:
            self._ask(plan)
            clock, began_s, received_s = StreamClock(), None, time.monotonic()
            while began_s is None or passage.seen_s - began_s < way.path[-1].t_s:
                self._check(roi.id)
                frame = inbox.take(_TAKE_S)
                now = time.monotonic()
                if frame is None:
                    if now - received_s > self._camera.blind_after_s:
                        raise Ended(Outcome.FAILED, ProofReason.NO_FRAMES)
                    continue
                if not inbox.same_clock:
                    frame = on_this_clock(frame, clock, now)
                received_s, passage.seen_s = now, frame.capture_s
                began_s = frame.capture_s if began_s is None else began_s
                results = pipeline.process(frame, now)
                pipeline.check_fit()
                for result in results:
                    self._publish(result)
                    passage.take(result, frame, way, frame.capture_s - began_s, size, time.monotonic())
                if passage.outcome is Outcome.PASSED:
                    return  # the camera's process sends a few more frames, to nobody
        finally:
            inbox.close()

    def _check(self, roi: str) -> None:
        if self._site_state.stopped(0.0):
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.STOPPED)
        decision = self._site_state.decision(roi)
        if decision is not Decision.CLEAR:
            blind = decision is Decision.BLIND
            raise Ended(Outcome.INCONCLUSIVE, ProofReason.BLIND if blind else ProofReason.DISTURBED)

    def _way(self, roi: RoiConfig, prior: Prior | None, cut: LumpCut | None, size: tuple[int, int]) -> Way:
        geometry = make_region(roi, *size)
        if roi.watches_mouth:
            return way_into(geometry, roi, size)
        learned = prior.learned if prior else None
        profile = make_profile(roi.detector.size_h, learned, geometry)
        settle_s = roi.proof_test.settle_s
        height = float(geometry.shape[0])
        size_of = (1.0, 1.0) if cut is None else over_profile(cut, profile, height)
        if roi.calibration is None:
            return make_way(geometry, profile, size, settle_s, size_of=size_of)
        plane, limit_mm = make_plane(roi.calibration, *size), roi.calibration.limit_mm
        box = None if cut is None else geometry.to_frame(height * np.array([cut.box]))[0]
        sides = partial(sides_on_belt, plane, limit_mm, box)
        return make_way(
            geometry, profile, size, settle_s, sides, lambda box: reached_lip(plane, box), size_of=size_of
        )

    def _lump(self, roi: RoiConfig, prior: Prior | None, last: ProofResult | None) -> LumpCut | None:
        """The labelled lump to show; None where one is drawn."""
        if prior is None or roi.watches_mouth or roi.proof_test.lump == "drawn":
            return None
        return next_lump(self._lumps(roi.id, prior.version), last)

    def _ask(self, plan: BlendPlan) -> None:
        replies = self._bus.ask(self._keys.blend(self._camera.id), payload=plan.line(), timeout_s=_DRAW_S)
        if any(reply.payload is not None for reply in replies):
            return
        error = replies[0].error if replies else "nobody answers"
        log.error("%s: proof test: the camera's process: %s", self._camera.id, error)
        raise Ended(Outcome.FAILED, ProofReason.NO_CAMERA)

    def _publish(self, result: RoiResult) -> None:
        """The alarms of the test chain, on the test key."""
        for change in result.changes:
            if change.alarm_class not in (AlarmClass.LUMP, AlarmClass.BLOCKED):
                continue
            self._sequence += 1
            clocks = Clocks(time.monotonic(), time.time())
            record = alarm_event(
                result, change, self._site, self._camera.id, self._sequence, clocks, test=True
            )
            self._alarms[result.roi].put(record.line())


def _alone(roi: RoiConfig) -> RoiConfig:
    """The region as it is tested: without the others that tell it of the feed."""
    if roi.watches_mouth:
        return roi.model_copy(update={"mouth": roi.mouth.model_copy(update={"belt": None})})
    return roi.model_copy(update={"feed": roi.feed.model_copy(update={"enabled": False})})


def _now() -> datetime:
    return utc(time.time())
