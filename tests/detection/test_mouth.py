"""A region that watches a mouth, through the pipeline of its camera: decisions, the alarm, and what it hears."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    BlindReason,
    BlockedReason,
    Change,
    Decision,
    DetectedObject,
    Detection,
    FeedState,
    FeedStatus,
    Frame,
    PlantFeed,
    RoiResult,
)
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.detection.channel import Heard
from lumpwatch.service.detection.mouth_channel import MouthChannel
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import decode_state
from lumpwatch.service.evidence.state_file import encode_state
from tests.detection.filmed_belts import filmed
from tests.models.test_mouth import HEIGHT, ORE, SPEED, STEP_S, WALL, WIDTH
from tests.service_helpers import prior, site

WHOLE = [[0, 0], [1, 0], [1, 1], [0, 1]]


def camera(**mouth: Any) -> CameraConfig:
    roi = {"id": "mouth", "watch": "mouth", "polygon": WHOLE, "mouth": {"learn_s": 4.0} | mouth}
    tree = {"id": "cam", "source": {"url": "clip.mp4"}, "rois": [roi], "quality": {"enabled": False}}
    return site({"site": "pit", "cameras": [tree]}).cameras[0]


class Scene:
    """Pictures of a mouth, one every fifth of a second, for one pipeline."""

    def __init__(self, config: CameraConfig | None = None, **how: Any) -> None:
        self.pipeline = CameraPipeline(config or camera(), **how)
        self.rng = np.random.default_rng(1)
        self.seq, self.moved = 0, 0.0

    def look(self, seconds: float, speed: float = SPEED) -> Iterator[RoiResult]:
        for _ in range(round(seconds / STEP_S)):
            self.moved += speed * STEP_S
            rows = (np.arange(HEIGHT) - round(self.moved)) % len(ORE)
            noisy = ORE[rows] + self.rng.normal(0, 1.5, (HEIGHT, WIDTH))
            data = np.asarray(np.clip(noisy, 0, 255), np.uint8)
            at = self.seq * STEP_S
            frame = Frame(self.seq, at, at, 1.7e9 + at, WIDTH, HEIGHT, "gray8", data)
            self.seq += 1
            yield from self.pipeline.process(frame, at)


def changes(results: list[RoiResult]) -> list[tuple[Change, str | None, float]]:
    """Of the blocked alarm."""
    return [
        (change.transition.change, change.transition.reason, change.transition.time_s)
        for result in results
        for change in result.changes
        if change.alarm_class is AlarmClass.BLOCKED
    ]


def test_it_is_blind_until_the_mouth_is_known_then_clear_then_blocked_and_clear_again() -> None:
    scene = Scene()
    first = list(scene.look(10.0))
    assert first[0].decision is Decision.BLIND
    assert first[0].reason is BlindReason.STARTING
    assert first[-1].decision is Decision.CLEAR
    stands = list(scene.look(14.0, 0.0))
    ((change, reason, raised_s),) = changes(stands)
    assert (change, reason) == (Change.RAISED, "standing")
    assert 7.5 <= raised_s - 10.0 <= 10.0  # within on_delay_s and two seconds
    assert stands[-1].decision is Decision.BLOCKED
    assert stands[-1].blockage is not None
    assert stands[-1].blockage.reason is BlockedReason.STANDING
    assert stands[-1].blockage.stood_s > 10.0
    assert not any(result.alarm.active for result in stands)  # it has no lump alarm
    free = list(scene.look(6.0))
    ((change, reason, cleared_s),) = changes(free)
    assert change is Change.CLEARED
    assert 2.0 <= cleared_s - 24.0 <= 5.0
    assert free[-1].decision is Decision.CLEAR


def test_nothing_is_raised_while_the_plant_says_that_the_feed_stands() -> None:
    scene = Scene()
    list(scene.look(10.0))
    scene.pipeline.plant("mouth", PlantFeed("feeder", 1e9, runs=False))
    results = list(scene.look(15.0, 0.0))
    assert not changes(results)
    scene.pipeline.plant("mouth", PlantFeed("feeder", 1e9, runs=True))
    ((change, _, at_s),) = changes(list(scene.look(12.0, 0.0)))
    assert change is Change.RAISED
    assert 7.0 <= at_s - 25.0 <= 10.0
    # Once blocked, that the feeder was stopped for it clears nothing.
    scene.pipeline.plant("mouth", PlantFeed("feeder", 1e9, runs=False))
    later = list(scene.look(10.0, 0.0))
    assert not changes(later)
    assert later[-1].decision is Decision.BLOCKED


def test_a_signal_that_has_expired_holds_nothing_back() -> None:
    scene = Scene()
    list(scene.look(10.0))
    scene.pipeline.plant("mouth", PlantFeed("feeder", 11.0, runs=False))
    assert [change for change, _, _ in changes(list(scene.look(12.0, 0.0)))] == [Change.RAISED]


def test_an_alarm_of_before_a_restart_stands_until_the_mouth_is_seen_to_swallow() -> None:
    scene = Scene(alarms={("mouth", AlarmClass.BLOCKED): Alarm(active=True, waits=True)})
    stands = list(scene.look(6.0, 0.0))
    assert not changes(stands)
    assert stands[-1].alarms[AlarmClass.BLOCKED].active
    swallows = list(scene.look(12.0))
    assert [change for change, _, _ in changes(swallows)] == [Change.CLEARED]
    assert swallows[-1].decision is Decision.CLEAR


def test_what_stands_from_the_first_picture_on_is_announced_though_the_mouth_is_not_known() -> None:
    scene = Scene()
    results = list(scene.look(12.0, 0.0))
    assert [change for change, _, _ in changes(results)] == [Change.RAISED]
    assert results[-1].decision is Decision.BLOCKED


def test_going_on_from_a_stored_state_decides_the_same() -> None:
    one, other = Scene(), Scene()
    list(one.look(10.0))
    list(one.look(3.0, 0.0))
    stored = one.pipeline.snapshots()["mouth"]
    again = decode_state(encode_state(stored), "state", None)
    assert stored.exact
    other.pipeline.restore("mouth", again)
    other.seq, other.moved = one.seq, one.moved
    one.rng, other.rng = np.random.default_rng(7), np.random.default_rng(7)
    live = [replace(result, frame=None) for result in one.look(9.0, 0.0)]
    assert live == [replace(result, frame=None) for result in other.look(9.0, 0.0)]
    assert changes(live)


def test_the_feed_of_the_belt_and_the_plant_decide_whether_time_counts() -> None:
    channel = MouthChannel(camera().rois[0])
    counts = []
    for state, plant in (
        (FeedState.RUNNING, None),
        (FeedState.RUNNING, False),  # seen, whatever the plant says
        (FeedState.STOPPED, True),
        (FeedState.EMPTY, None),
        (FeedState.UNKNOWN, None),
        (FeedState.UNKNOWN, True),
        (FeedState.UNKNOWN, False),
    ):
        channel.hear(Heard(FeedStatus(state), plant))
        counts.append(channel._runs)
    assert counts == [True, True, False, False, True, True, False]


class Emptied:
    """A mouth of which the belt says what the feed does; its wall is seen where nothing lies in it."""

    def __init__(self) -> None:
        self.channel, self.rng = MouthChannel(camera().rois[0]), np.random.default_rng(3)
        self.channel.fit(WIDTH, HEIGHT)
        self.seq, self.moved = 0, 0.0
        self.raised_s: list[float] = []

    def look(self, seconds: float, feed: FeedState, speed: float | None) -> None:
        """`speed` of the ore, px/s; None: an empty mouth."""
        for _ in range(round(seconds / STEP_S)):
            self.moved += (speed or 0.0) * STEP_S
            shown = WALL if speed is None else ORE[(np.arange(HEIGHT) - round(self.moved)) % len(ORE)]
            data = np.asarray(np.clip(shown + self.rng.normal(0, 1.5, shown.shape), 0, 255), np.uint8)
            at = self.seq * STEP_S
            self.channel.hear(Heard(FeedStatus(feed)))
            told = self.channel.step(Frame(self.seq, at, at, at, WIDTH, HEIGHT, "gray8", data))
            self.seq += 1
            if told is not None and told.change is Change.RAISED:
                self.raised_s.append(at)


def test_walls_of_an_empty_mouth_are_no_blockage_before_ore_comes_again() -> None:
    mouth = Emptied()
    mouth.look(10.0, FeedState.RUNNING, SPEED)
    mouth.look(8.0, FeedState.EMPTY, None)
    mouth.look(14.0, FeedState.RUNNING, None)  # ore rides on the belt, and is not at its end yet
    mouth.look(6.0, FeedState.RUNNING, SPEED)
    assert not mouth.raised_s
    mouth.look(12.0, FeedState.RUNNING, 0.0)
    assert [7.5 <= at - 38.0 <= 10.0 for at in mouth.raised_s] == [True]


def test_a_mouth_in_which_nothing_moves_at_all_after_an_empty_belt_is_announced_in_the_end() -> None:
    mouth = Emptied()
    mouth.look(10.0, FeedState.RUNNING, SPEED)
    mouth.look(8.0, FeedState.EMPTY, 0.0)
    mouth.look(42.0, FeedState.RUNNING, 0.0)
    assert [36.0 <= at - 18.0 <= 41.0 for at in mouth.raised_s] == [True]


@pytest.mark.parametrize(("waited", "came"), [(True, True), (True, False), (False, True)])
def test_a_lump_that_was_followed_into_the_mouth_and_stands_there(waited: bool, came: bool) -> None:
    config = camera(lumps=waited).rois[0]
    channel, rng = MouthChannel(config), np.random.default_rng(3)
    channel.fit(WIDTH, HEIGHT)
    box = DetectedObject(
        id=4, x=45.0, y=-25.0, w=40.0, h=32.0, spread_x=1.0, spread_y=1.0, existence=0.95, model="belt"
    )
    found = Detection(0.95, (box,))
    for k in range(110):
        ore = ORE[(np.arange(HEIGHT) - round(SPEED * k * STEP_S)) % len(ORE)].copy()
        if k >= 55:
            ore[16:48, 40:80] = WALL[16:48, 40:80]
        data = np.asarray(np.clip(ore + rng.normal(0, 1.5, ore.shape), 0, 255), np.uint8)
        before = came and 48 <= k < 54
        channel.hear(Heard(FeedStatus(FeedState.RUNNING), None, found if before else Detection(0.0, ())))
        at = k * STEP_S
        channel.step(Frame(k, at, at, at, WIDTH, HEIGHT, "gray8", data))
    assert channel.blockage is not None
    blocks = waited and came
    assert channel.blockage.reason is (BlockedReason.LUMP if blocks else None)
    assert channel.alarm.active is blocks


def test_a_mouth_has_no_prior() -> None:
    channel = MouthChannel(camera().rois[0])
    channel.use(None)
    with pytest.raises(LumpwatchError, match="which has no prior"):
        channel.use(prior())


def test_a_mouth_that_is_too_small_for_its_windows_is_blind_and_says_so() -> None:
    tree = json.loads(camera().model_dump_json(exclude={"source": {"url"}}))
    tree["source"]["url"] = "clip.mp4"
    tree["rois"][0]["polygon"] = [[0, 0], [1, 0], [1, 0.1], [0, 0.1]]
    scene = Scene(CameraConfig.model_validate(tree))
    (result,) = scene.look(STEP_S)
    assert (result.decision, result.reason) == (Decision.BLIND, BlindReason.UNFIT)


@pytest.mark.parametrize("belt", ["limestone", "fines"])
def test_a_real_belt_that_runs_is_no_blocked_mouth(belt: str) -> None:
    pictures, polygon = filmed(belt)
    height, width = pictures[0].shape
    channel = MouthChannel(camera().rois[0].model_copy(update={"polygon": polygon}))
    channel.fit(width, height)
    channel.hear(Heard(FeedStatus(FeedState.RUNNING)))
    stood = []
    for k in range(60):  # the clip, again and again
        at = k * STEP_S
        picture = pictures[round(24 * at) % len(pictures)]
        channel.step(Frame(k, at, at, at, width, height, "gray8", picture))
        assert channel.blockage is not None
        stood.append(channel.blockage.stood_s)
    assert not channel.alarm.active
    assert max(stood) < 4.0, max(stood)
