"""CLEAR needs enough frames that were judged, of late: the account of them, and what the pipeline makes of it."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief
from lumpwatch.service.config import DetectorConfig, JdtConfig, SightConfig
from lumpwatch.service.core.alarm import AlarmClass, AlarmState, Change
from lumpwatch.service.core.decision import BlindReason, Decision, RoiResult
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.detectors.base import FilterState
from lumpwatch.service.detection.sight import Sight
from tests.belt_scene import CONFIG as BELT_CONFIG
from tests.belt_scene import FPS, REFERENCE, belt
from tests.service_helpers import HEIGHT, WIDTH, camera, frame, prior

RULES = SightConfig()
_EVERY_FRAME = tuple(roi.model_copy(update={"decide_hz": "all"}) for roi in camera().rois)
CONFIG = camera().model_copy(update={"sight": RULES, "blind_after_s": 3.0, "rois": _EVERY_FRAME})


class Ailing:
    """A detector that finds nothing, and fails while it is told to."""

    def __init__(self, roi: Roi, ails: set[str]) -> None:
        self._roi, self.ails, self.learns = roi, ails, True

    @property
    def roi(self) -> Roi:
        return self._roi

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        if "fails" in self.ails:
            raise FloatingPointError("weights")
        return Detection(0.95 if "lump" in self.ails else 0.01, ())

    def use(self, learned: Learned | None) -> None:
        """Nothing to use it for."""

    def clouds(self) -> tuple[Belief, ...]:
        return ()

    def state(self) -> None:
        """None that could be kept."""

    def restore(self, state: FilterState) -> None:
        """Nothing."""


class Belt:
    """A pipeline of the default rules on a clock of its own."""

    def __init__(self) -> None:
        self.ails: set[str] = set()
        self.drops: list[str] = []
        self.pipeline = CameraPipeline(CONFIG, {"apron": prior()}, make=self._make, observer=self)
        self.now, self.seq = 100.0, 0

    def _make(self, config: DetectorConfig, roi: Roi, learned: Learned | None) -> Ailing:
        assert isinstance(config, JdtConfig)
        return Ailing(roi, self.ails)

    def dropped(self, reason: str) -> None:
        self.drops.append(reason)

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        """Not looked at."""

    def paced(self, roi: str) -> None:
        """Not looked at."""

    def prior_refused(self, roi: str, reason: str) -> None:
        assert (roi, reason) == ("apron", "failed")

    def frame(self, after_s: float, size: tuple[int, int] = (WIDTH, HEIGHT)) -> RoiResult:
        """The next frame, so many seconds after the last."""
        self.now += after_s
        self.seq += 1
        shown = frame(self.seq, time_s=self.now, size=size)
        (result,) = self.pipeline.process(shown, self.now) or self.pipeline.poll(self.now)
        return result

    def frames(self, seconds: float, every_s: float = 0.04) -> list[RoiResult]:
        return [self.frame(every_s) for _ in range(round(seconds / every_s))]

    def wait(self, seconds: float) -> list[RoiResult]:
        """No frame comes; the monitor polls."""
        said: list[RoiResult] = []
        for _ in range(math.ceil(seconds / 0.25)):
            self.now += 0.25
            said += self.pipeline.poll(self.now)
        return said


def blind_alarm(results: list[RoiResult]) -> list[tuple[Change, str | None]]:
    return [
        (change.transition.change, change.transition.reason)
        for result in results
        for change in result.changes
        if change.alarm_class is AlarmClass.BLIND
    ]


def states(results: list[RoiResult]) -> list[tuple[str, str | None]]:
    """Each state and reason, in order, once as long as it lasts."""
    said = [(result.decision.value, result.reason and result.reason.value) for result in results]
    return [one for k, one in enumerate(said) if k == 0 or one != said[k - 1]]


def test_a_start_is_blind_until_a_lump_would_have_been_found() -> None:
    belt = Belt()
    first = belt.frames(1.96)
    assert states(first) == [("BLIND", "starting")]
    assert states(belt.frames(8.0)) == [("BLIND", "starting"), ("CLEAR", None)]
    assert blind_alarm(first) == []


@pytest.mark.parametrize(("every_s", "clear_after_s"), [(0.04, 2.0), (0.1, 2.0), (0.2, 3.8), (0.25, 4.75)])
def test_warming_up_takes_frames_and_time(every_s: float, clear_after_s: float) -> None:
    belt = Belt()
    began = belt.now + every_s
    said = belt.frames(8.0, every_s)
    first = next(k for k, result in enumerate(said) if result.decision is Decision.CLEAR)
    assert began + first * every_s - began == pytest.approx(clear_after_s, abs=every_s + 1e-6)


@pytest.mark.parametrize("every_s", [0.3, 1.0, 1.6, 2.9])
def test_few_frames_are_blind_and_an_alarm(every_s: float) -> None:
    belt = Belt()
    said = belt.frames(40.0, every_s)
    assert {result.decision for result in said} == {Decision.BLIND}
    assert said[-1].reason is BlindReason.FEW_FRAMES
    assert [change for change, _ in blind_alarm(said)] == [Change.RAISED]


def test_a_lump_counts_however_few_frames_showed_it() -> None:
    belt = Belt()
    belt.ails.add("lump")
    said = belt.frames(1.0)
    assert states(said) == [("BLIND", "starting"), ("LUMP", None)]
    belt.ails.clear()
    assert {result.decision for result in belt.frames(1.0)} == {Decision.LUMP}


def test_a_start_clears_no_lump_alarm_before_it_has_looked() -> None:
    belt = Belt()
    belt.ails.add("lump")
    belt.frames(4.0)
    belt.ails.clear()
    belt.wait(10.0)
    off_delay_s = CONFIG.rois[0].alarm.off_delay_s
    assert {result.alarm.active for result in belt.frames(RULES.warm_up_s)} == {True}
    assert not belt.frames(off_delay_s + 0.2)[-1].alarm.active


def test_a_filter_that_fails_every_second_frame_is_blind_and_raises(caplog: pytest.LogCaptureFixture) -> None:
    belt = Belt()
    belt.frames(10.0)
    said = []
    with caplog.at_level(logging.ERROR):
        for k in range(500):
            belt.ails.clear()
            belt.ails.update({"fails"} if k % 2 else ())
            said.append(belt.frame(0.04))
    assert states(said[1:]) == [("BLIND", "filter")]
    assert blind_alarm(said) == [(Change.RAISED, "filter")]
    assert belt.drops.count("failed") == 250
    assert sum(record.exc_info is not None for record in caplog.records) == 1
    belt.ails.clear()
    assert states(belt.frames(4.0)) == [("BLIND", "filter"), ("CLEAR", None)]


def test_a_frame_from_the_future_changes_nothing() -> None:
    belt, undisturbed = Belt(), Belt()
    belt.frames(4.0)
    undisturbed.frames(4.0)
    for time_s in (belt.now + 0.2, belt.now + 1e9, math.inf, math.nan):
        forged = frame(7, time_s=time_s)
        assert belt.pipeline.process(forged, belt.now) == ()
        assert belt.pipeline.process(replace(forged, capture_s=belt.now, received_s=time_s), belt.now) == ()
    assert belt.drops == ["future"] * 8
    assert states(belt.frames(4.0)) == states(undisturbed.frames(4.0)) == [("CLEAR", None)]


def test_what_stops_deciding_is_blind_though_frames_come() -> None:
    belt = Belt()
    belt.frames(4.0)
    said: list[RoiResult] = []
    for _ in range(200):  # each looks like the last one
        belt.now += 0.04
        assert belt.pipeline.process(frame(1, time_s=104.0, received_s=belt.now), belt.now) == ()
        said += belt.pipeline.poll(belt.now)
    assert said[-1].decision is Decision.BLIND
    assert [change for change, _ in blind_alarm(said)] == [Change.RAISED] or said[-1].blind_alarm.active


def test_flapping_ends_in_an_alarm_that_stands() -> None:
    """4 s of sight and 2.5 s without, again and again: no break is as long as `on_delay_s`."""
    belt = Belt()
    said = belt.frames(6.0)
    for _ in range(12):
        said += belt.frames(4.0) + belt.wait(2.5)
    changes = [change for change, _ in blind_alarm(said)]
    assert changes == [Change.RAISED]
    window_s = CONFIG.rois[0].alarm.blind.summed_over_s
    after = belt.frames(RULES.warm_up_s + window_s - 8.0, 0.1)
    assert blind_alarm(after) == []
    assert [change for change, _ in blind_alarm(belt.frames(8.0))] == [Change.CLEARED]


def test_one_outage_clears_as_soon_as_it_is_over() -> None:
    belt = Belt()
    belt.frames(60.0, 0.1)
    assert [change for change, _ in blind_alarm(belt.wait(20.0))] == [Change.RAISED]
    off_delay_s = CONFIG.rois[0].alarm.blind.off_delay_s
    assert belt.frames(RULES.warm_up_s + off_delay_s + 0.2)[-1].blind_alarm.state is AlarmState.NORMAL


def test_a_size_that_changes_with_every_frame_is_never_clear() -> None:
    belt = Belt()
    said = [belt.frame(0.04, (WIDTH * (1 + k % 2), HEIGHT * (1 + k % 2))) for k in range(300)]
    assert {result.decision for result in said} == {Decision.BLIND}
    assert said[-1].blind_alarm.active


EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("frames"), st.integers(1, 60), st.sampled_from((0.02, 0.04, 0.1, 0.2, 0.5, 1.2))),
        st.tuples(st.just("fails"), st.integers(1, 3), st.just(0.04)),
        st.tuples(st.just("nothing"), st.integers(1, 20), st.just(0.25)),
        st.tuples(st.just("future"), st.integers(1, 3), st.just(0.0)),
        st.tuples(st.just("size"), st.integers(1, 3), st.just(0.04)),
    ),
    max_size=14,
)


@settings(max_examples=80, deadline=None)
@given(EVENTS)
def test_no_stretch_is_clear_without_frames_enough_to_find_a_lump(
    events: list[tuple[str, int, float]],
) -> None:
    """Whatever comes: at any time that is CLEAR, `least_frames` were judged in the `within_s` before it, by one
    filter that lived for `warm_up_s` and saw no longer gap than `longest_gap_s` before the last of them."""
    belt = Belt()
    judged: list[float] = []
    for kind, count, every_s in events:
        for _ in range(count):
            size = (2 * WIDTH, 2 * HEIGHT) if kind == "size" else (WIDTH, HEIGHT)
            belt.ails.clear()
            belt.ails.update({"fails"} if kind == "fails" else ())
            if kind == "nothing":
                result = belt.wait(every_s)[-1]
            elif kind == "future":
                assert belt.pipeline.process(frame(1, time_s=belt.now + 5.0), belt.now) == ()
                (result,) = belt.pipeline.poll(belt.now)
            else:
                before = belt.pipeline.size
                result = belt.frame(every_s, size)
                gap_s = belt.now - judged[-1] if judged else 0.0
                if kind == "fails" or before != size or gap_s > RULES.longest_gap_s + 1e-6:
                    judged.clear()
                if kind != "fails":
                    judged.append(belt.now)
            if result.decision is Decision.CLEAR:
                recent = [time_s for time_s in judged if belt.now - time_s <= RULES.within_s + 1e-6]
                assert len(recent) >= RULES.least_frames
                assert judged[-1] - judged[0] >= RULES.warm_up_s - 1e-6
                assert belt.now - judged[-1] <= CONFIG.blind_after_s + 1e-6


@pytest.mark.parametrize(
    ("ride_s", "every_s", "expected"),
    [(None, 0.2, None), (2.0, 0.2, BlindReason.FEW_FRAMES), (2.0, 0.08, None)],
)
def test_a_fast_belt_needs_more_frames(
    ride_s: float | None, every_s: float, expected: BlindReason | None
) -> None:
    sight = Sight(RULES, 3.0)
    sight.ride(ride_s)
    for k in range(100):
        sight.judged(k * every_s)
    assert sight.reason(99 * every_s) is expected


def test_a_reference_of_another_working_size_is_refused_once_and_comes_back(
    caplog: pytest.LogCaptureFixture,
) -> None:
    pipeline = CameraPipeline(BELT_CONFIG, {"apron": prior()}, reference=REFERENCE)

    def say(first: int, scale: float) -> set[BlindReason | None]:
        said = set()
        for k in range(first, first + 10):
            small = cv2.resize(belt(k), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            shown = np.asarray(small, np.uint8)
            size = (shown.shape[1], shown.shape[0])
            now = k / FPS
            said |= {one.reason for one in pipeline.process(frame(k, time_s=now, data=shown, size=size), now)}
        return said

    def known() -> object:
        return pipeline.reference

    assert BlindReason.FILTER not in say(0, 1.0)
    assert known() is REFERENCE
    assert BlindReason.FILTER not in say(10, 0.5)
    assert known() is None
    assert [record.getMessage().count("reference refused") for record in caplog.records].count(1) == 1
    assert BlindReason.FILTER not in say(20, 1.0)
    assert known() is REFERENCE
