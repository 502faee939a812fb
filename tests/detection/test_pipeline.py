"""The pipeline of one camera: which frames count, when it is blind, and what a new prior changes."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.capture.camera_process import Reducer
from lumpwatch.service.config import CalibrationConfig, CameraConfig, DetectorConfig, JdtConfig, QualityConfig
from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmState, Change, all_of, shelve
from lumpwatch.service.core.decision import BlindReason, Decision, RoiResult, Trouble
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.channel import RegionMisfitError
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from lumpwatch.service.storage.prior_file import Prior
from tests.service_helpers import (
    HEIGHT,
    POLYGON,
    WIDTH,
    bright_fit,
    camera,
    frame,
    learned,
    lump_fit,
    picture,
    prior,
    site,
    site_tree,
)


class Counting:
    """An observer that counts."""

    def __init__(self) -> None:
        self.drops: Counter[str] = Counter()
        self.stages: Counter[tuple[str, str]] = Counter()
        self.refused: Counter[tuple[str, str]] = Counter()

    def dropped(self, reason: str) -> None:
        self.drops[reason] += 1

    def stage(self, stage: str, roi: str, seconds: float) -> None:
        assert seconds >= 0
        self.stages[stage, roi] += 1

    def paced(self, roi: str) -> None:
        """Not looked at."""

    def prior_refused(self, roi: str, reason: str) -> None:
        self.refused[roi, reason] += 1


def pipeline(
    config: CameraConfig | None = None, used: Prior | None = None, observer: Counting | None = None
) -> CameraPipeline:
    return CameraPipeline(config or camera(), {"apron": used or prior(version=3)}, observer=observer)


def feed(target: CameraPipeline, frames: list[Frame]) -> list[RoiResult]:
    return [result for one in frames for result in target.process(one, one.received_s)]


def scene(dark: int, bright: int, dark_again: int = 0) -> list[Frame]:
    """Frames without, with, and again without the object, at 10 a second."""
    return [frame(k, bright=dark <= k < dark + bright) for k in range(dark + bright + dark_again)]


def bare(result: RoiResult) -> RoiResult:
    """Without the pixels, which cannot be compared."""
    return replace(result, frame=None)


# Deciding


def test_an_object_raises_the_alarm_and_its_end_clears_it() -> None:
    results = feed(pipeline(), scene(10, 20, 20))
    assert [r.decision for r in results[:10]] == [Decision.CLEAR] * 10
    changes = [(r.transition.change, r.transition.time_s) for r in results if r.transition]
    assert [change for change, _ in changes] == [Change.RAISED, Change.CLEARED]
    (_, raised_s), (_, cleared_s) = changes
    assert 1.2 - 1e-6 <= raised_s < 3.0  # not before 0.2 s of evidence
    assert 3.2 - 1e-6 <= cleared_s < 5.0
    by_time = {round(r.frame.capture_s, 3): r for r in results if r.frame}
    assert by_time[2.9].decision is Decision.LUMP
    assert by_time[4.9].decision is Decision.CLEAR
    assert by_time[4.9].alarm.state is AlarmState.RETURNED
    assert all(r.decided and r.reason is None and r.prior == 3 for r in results)
    detection = by_time[2.9].detection
    assert detection is not None
    (found,) = detection.objects
    # The square is 14 px wide around (48, 32); a box within it is as good as the whole.
    assert abs(found.x + found.w / 2 - 48) < 5
    assert abs(found.y + found.h / 2 - 32) < 5
    assert found.model == "constant_velocity"
    assert 0.9 < found.existence <= by_time[2.9].existence


def test_each_new_object_gets_the_next_id() -> None:
    results = feed(pipeline(), scene(2, 20, 30) + [frame(k, bright=True) for k in range(52, 70)])
    ids = [found.id for r in results if r.detection for found in r.detection.objects]
    assert ids == sorted(ids)
    assert set(ids) == {1, 2}


@pytest.mark.parametrize("form", ["marginal", "sampled"])
@pytest.mark.parametrize("switching", ["adaptive", "fixed"])
def test_the_same_frames_give_the_same_results(form: str, switching: str) -> None:
    config = camera(form=form, switching=switching)
    frames = scene(5, 10, 5)
    once = [bare(r) for r in feed(pipeline(config), frames)]
    assert once == [bare(r) for r in feed(pipeline(config), frames)]
    assert max(r.existence for r in once) > 0.9


def test_another_seed_gives_other_particles() -> None:
    frames = scene(2, 5)
    one = [r.existence for r in feed(pipeline(camera(seed=1)), frames)]
    assert one != [r.existence for r in feed(pipeline(camera(seed=2)), frames)]


def test_acknowledging() -> None:
    target = pipeline()
    feed(target, scene(0, 20))
    result = target.acknowledge("apron", "Ada", 2.0)
    assert result.transition is not None
    assert (result.transition.change, result.transition.actor) == (Change.ACKNOWLEDGED, "Ada")
    assert (result.alarm.state, result.decision, result.decided) == (
        AlarmState.ACKNOWLEDGED,
        Decision.LUMP,
        False,
    )
    assert target.acknowledge("apron", "Bob", 2.1).transition is None
    with pytest.raises(KeyError):
        target.acknowledge("chute", "Ada", 2.2)


def test_a_prior_is_taken_and_left_for_the_defaults() -> None:
    known = prior(learned(likelihood=lump_fit()), version=3)
    target = pipeline(camera(likelihood={"kind": "lump"}), known)
    assert feed(target, [frame(0)])[0].prior == 3
    target.use_prior("apron", None)
    assert feed(target, [frame(1)])[0].prior == 0


def test_stages_are_timed_for_each_frame() -> None:
    seen = Counting()
    feed(pipeline(observer=seen), scene(4, 0))
    assert seen.stages == {
        ("cut", "apron"): 4,
        ("quality", "apron"): 4,
        ("feed", "apron"): 4,
        ("filter", "apron"): 4,
    }


# Which frames count


def test_duplicate_and_late_frames_are_dropped_and_counted() -> None:
    seen = Counting()
    target = pipeline(observer=seen)
    frames = scene(3, 6)
    expected = [bare(r) for r in feed(pipeline(), frames)]
    disturbed: list[Frame] = []
    for one in frames:
        disturbed += [one, replace(one, seq=900), replace(one, capture_s=one.capture_s - 0.05)]
    assert [bare(r) for r in feed(target, disturbed)] == expected
    assert seen.drops == {"duplicate": 9, "late": 9}


def test_a_missing_frame_is_a_longer_step() -> None:
    frames = [one for one in scene(5, 25) if one.seq % 3]
    results = feed(pipeline(), frames)
    assert results[-1].decision is Decision.LUMP
    assert len(results) == len(frames)


def test_after_a_long_gap_the_search_starts_anew() -> None:
    target = pipeline()
    before = feed(target, scene(0, 20))[-1]
    (after,) = target.process(frame(20, time_s=60.0), 60.0)
    assert before.existence > 0.99
    assert after.existence < 0.2


# Blindness


def test_blind_before_the_first_frame() -> None:
    (result,) = pipeline().poll(5.0)
    assert (result.decision, result.reason, result.frame, result.decided) == (
        Decision.BLIND,
        BlindReason.STARTING,
        None,
        False,
    )
    assert result.existence == 0.0


def test_blind_when_frames_stop_coming() -> None:
    target = pipeline()  # blind_after_s is 1
    feed(target, scene(5, 0))  # the last at 0.4 s
    assert target.poll(1.4)[0].decision is Decision.CLEAR
    (result,) = target.poll(1.41)
    assert (result.decision, result.reason) == (Decision.BLIND, BlindReason.NO_STREAM)
    (result,) = target.process(frame(20), 2.0)
    assert (result.decision, result.reason) == (Decision.CLEAR, None)


def test_duplicates_do_not_keep_the_picture_alive() -> None:
    target = pipeline()
    feed(target, scene(5, 0))
    assert target.process(frame(5, time_s=0.4, received_s=1.5), 1.5) == ()
    assert target.poll(1.5)[0].reason is BlindReason.NO_STREAM


def test_blind_when_pictures_are_old_though_they_come() -> None:
    target = pipeline()
    (result,) = target.process(frame(0, time_s=10.0, received_s=10.9), 10.9)
    assert result.decision is Decision.CLEAR
    (result,) = target.process(frame(1, time_s=10.1, received_s=11.2), 11.2)
    assert (result.decision, result.reason) == (Decision.BLIND, BlindReason.STALE)
    assert result.decided


def test_blindness_does_not_touch_the_alarm() -> None:
    target = pipeline()
    feed(target, scene(0, 20))
    (result,) = target.poll(60.0)
    assert result.decision is Decision.BLIND
    assert result.alarm.state is AlarmState.UNACKNOWLEDGED


class Failing(JdtDetector):
    """A detector whose steps raise while it is told so."""

    fails = False

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        if self.fails:
            raise FloatingPointError("weights")
        return super().step(gray, colour, dt)


def test_a_filter_that_fails_is_blind_and_recovers(caplog: pytest.LogCaptureFixture) -> None:
    tree = site_tree()
    tree["cameras"][0]["rois"].append(tree["cameras"][0]["rois"][0] | {"id": "chute"})
    made: list[Failing] = []

    def make(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Failing:
        assert isinstance(config, JdtConfig)
        made.append(Failing(config, roi, learned))
        return made[-1]

    priors = {"apron": prior(), "chute": prior(roi="chute")}
    target = CameraPipeline(site(tree).cameras[0], priors, make=make)
    feed(target, scene(0, 20))
    made[0].fails = True
    with caplog.at_level(logging.ERROR):
        apron, chute = target.process(frame(20, bright=True), 2.0)
    assert (apron.decision, apron.reason, apron.decided) == (Decision.BLIND, BlindReason.FILTER, False)
    assert (chute.decision, chute.reason, chute.decided) == (Decision.LUMP, None, True)
    assert "camera cam, roi apron: " in caplog.text
    assert target.poll(2.05)[0].reason is BlindReason.FILTER
    assert apron.alarm.state is AlarmState.UNACKNOWLEDGED
    later = [target.process(frame(k, bright=True), k / 10)[0] for k in range(21, 35)]
    assert all(r.reason is None and r.decided for r in later)
    assert later[-1].existence > 0.9
    assert [r.transition for r in later if r.transition] == []


def test_a_picture_that_does_not_hold_what_it_says_is_a_failure_of_the_filter() -> None:
    target = pipeline()
    feed(target, scene(3, 0))
    (result,) = target.process(frame(3, data=picture(bright=False)[:20]), 0.3)
    assert result.reason is BlindReason.FILTER
    (result,) = target.process(frame(4), 0.4)
    assert result.reason is None


# Sizes of the picture


def test_another_size_makes_the_filter_anew() -> None:
    target = pipeline()
    feed(target, scene(3, 0))
    before = target.detector("apron")
    results = feed(target, [frame(k, bright=k > 5, size=(WIDTH * 2, HEIGHT * 2)) for k in range(3, 20)])
    after = target.detector("apron")
    assert before is not None
    assert after is not None
    assert (after.roi.width, after.roi.height) == (2 * before.roi.width, 2 * before.roi.height)
    assert results[-1].prior == 3
    assert results[-1].reason is None


SMALL = ((0.1, 0.1), (0.3, 0.1), (0.3, 0.4), (0.1, 0.4))
"""A region that is too small in pictures of 30 x 20."""


def two_regions() -> tuple[CameraConfig, dict[str, Prior | None]]:
    tree = site_tree()
    chute = tree["cameras"][0]["rois"][0] | {"id": "chute", "polygon": [list(point) for point in SMALL]}
    tree["cameras"][0]["rois"].append(chute)
    return site(tree).cameras[0], {"apron": prior(), "chute": prior(roi="chute", polygon=SMALL)}


def test_a_roi_that_does_not_fit_is_blind_and_says_why_once(caplog: pytest.LogCaptureFixture) -> None:
    target = pipeline()
    results = feed(target, [frame(k, size=(10, 8)) for k in range(80)])
    assert len(results) == 80
    assert {(r.decision, r.reason, r.decided) for r in results} == {
        (Decision.BLIND, BlindReason.UNFIT, False)
    }
    assert target.poll(7.95)[0].reason is BlindReason.UNFIT
    told = [record.getMessage() for record in caplog.records if "apron" in record.getMessage()]
    assert len(told) == 1
    assert "camera cam, roi apron" in told[0]
    assert "8 x 6 pixels" in told[0]
    (made,) = blind_changes(tuple(results))
    assert made[0] == "raised"
    assert (made[1] or "").startswith("unfit: ")
    assert "8 x 6 pixels" in (made[1] or "")
    with pytest.raises(RegionMisfitError, match=r"roi apron: .* 8 x 6 pixels"):
        target.check_fit()


def test_other_regions_go_on_beside_one_that_does_not_fit() -> None:
    config, priors = two_regions()
    target = CameraPipeline(config, priors)
    assert {r.reason for r in feed(target, scene(3, 0))} == {None}
    shown = picture(bright=False, width=30, height=20)
    shown[7:13, 12:18] = 250
    later = [target.process(frame(k, data=shown, size=(30, 20)), k / 10) for k in range(3, 30)]
    apron, chute = ([results[k] for results in later] for k in (0, 1))
    assert {(r.reason, r.decided) for r in apron} == {(None, True)}
    assert apron[-1].decision is Decision.LUMP
    assert {(r.reason, r.decided, r.detection) for r in chute} == {(BlindReason.UNFIT, False, None)}
    assert target.detector("chute") is None
    target.check_fit()
    back = target.process(frame(30), 3.0)
    assert [(r.reason, r.decided) for r in back] == [(None, True), (None, True)]
    detector = target.detector("chute")
    assert detector is not None
    assert (detector.roi.width, detector.roi.height) == (20, 20)


def test_a_region_that_does_not_fit_keeps_its_alarm() -> None:
    target = pipeline()
    before = feed(target, scene(0, 20))[-1]
    (after,) = target.process(frame(20, size=(10, 8)), 2.0)
    assert (after.decision, after.reason, after.existence) == (Decision.BLIND, BlindReason.UNFIT, 0.0)
    assert after.alarm == before.alarm
    assert after.alarm.state is AlarmState.UNACKNOWLEDGED


def test_a_calibration_that_shows_nothing_of_the_belt_blinds_its_region_alone() -> None:
    config, priors = two_regions()
    beyond = CalibrationConfig(
        points=((0.2, 0.6), (0.8, 0.6), (0.9, 0.9), (0.1, 0.9)),
        points_mm=((0, 0), (1500, 0), (1500, 60000), (0, 60000)),
        lip=((0.1, 0.9), (0.9, 0.9)),
        limit_mm=1e5,
    )
    rois = (config.rois[0], config.rois[1].model_copy(update={"calibration": beyond}))
    target = CameraPipeline(config.model_copy(update={"rois": rois}), priors)
    results = [target.process(one, one.received_s) for one in scene(3, 0)]
    assert [[r.reason for r in one] for one in results] == [[None, BlindReason.UNFIT]] * 3


def test_the_quality_of_the_others_is_measured_beside_one_that_does_not_fit() -> None:
    config, priors = two_regions()
    reversed_ = config.model_copy(update={"rois": config.rois[::-1], "quality": QualityConfig()})
    target = CameraPipeline(reversed_, priors)
    for k in range(10):
        chute, apron = target.process(frame(k, size=(30, 20)), k / 10)
    assert chute.quality.values == {}
    assert apron.quality.values != {}


# Priors


@pytest.mark.parametrize(
    "unfit",
    [
        prior(polygon=((0.0, 0.0), *POLYGON[1:]), version=9),
        prior(aspect=1.0, version=9),
        prior(learned(("belt",), lump_fit()), version=9),
        prior(learned(likelihood=bright_fit()), version=9),
    ],
    ids=["polygon", "shape", "models", "likelihood"],
)
def test_a_prior_that_does_not_fit_is_refused_and_defaults_are_used(unfit: Prior) -> None:
    config = camera(likelihood={"kind": "lump"})
    seen = Counting()
    target = pipeline(config, unfit, seen)
    frames = scene(3, 3)
    results = [bare(r) for r in feed(target, frames)]
    assert seen.refused == {("apron", "unfit"): 1}
    assert target.prior("apron") is None
    assert all(r.prior == 0 and r.decided for r in results)
    assert results == [bare(r) for r in feed(CameraPipeline(config), frames)]


def test_a_histogram_without_a_prior_waits_for_one() -> None:
    target = CameraPipeline(camera())
    (result,) = target.process(frame(0), 0.0)
    assert (result.reason, result.prior) == (BlindReason.UNFIT, 0)
    with pytest.raises(RegionMisfitError, match=r"histogram needs .*prior"):
        target.check_fit()
    target.use_prior("apron", prior(version=6))
    (result,) = target.process(frame(1), 0.1)
    assert (result.reason, result.prior, result.decided) == (None, 6, True)


def test_a_prior_that_is_refused_for_one_size_is_used_for_the_next() -> None:
    """Where the defaults do not do either, as with a histogram, it is kept."""
    target = pipeline()
    sizes = [(WIDTH, HEIGHT), (WIDTH, WIDTH), (WIDTH, HEIGHT)]
    results = feed(target, [frame(k, size=size) for k, size in enumerate(sizes)])
    assert [(r.reason, r.prior) for r in results] == [(None, 3), (BlindReason.UNFIT, 3), (None, 3)]


def test_a_new_prior_goes_on_with_the_alarm() -> None:
    target = pipeline()
    before = feed(target, scene(0, 20))[-1]
    target.use_prior("apron", prior(version=4))
    results = [target.process(frame(k, bright=True), k / 10)[0] for k in range(20, 30)]
    assert [r.prior for r in results] == [4] * 10
    assert all(r.decision is Decision.LUMP and r.existence > 0.9 for r in results)
    assert results[-1].alarm == before.alarm
    assert all(r.transition is None for r in results)


def test_a_prior_may_come_before_the_first_frame() -> None:
    target = CameraPipeline(camera())
    target.use_prior("apron", prior(version=5))
    assert target.process(frame(0), 0.0)[0].prior == 5


@pytest.mark.parametrize(
    "unfit",
    [
        prior(polygon=((0.0, 0.0), *POLYGON[1:]), version=9),
        prior(aspect=1.0, version=9),
        prior(learned(("belt",)), version=9),
        pytest.param(
            prior(
                replace(learned(likelihood=lump_fit()), velocity_noise=np.array([50.0])),
                version=9,
            )
        ),
    ],
    ids=["polygon", "shape", "models", "likelihood"],
)
def test_an_unfit_new_prior_changes_nothing(unfit: Prior) -> None:
    seen = Counting()
    target, untouched = pipeline(observer=seen), pipeline()
    frames = scene(3, 12)
    feed(target, frames[:8])
    feed(untouched, frames[:8])
    target.use_prior("apron", unfit)
    assert seen.refused == {("apron", "unfit"): 1}
    used = target.prior("apron")
    assert used is not None
    assert used.version == 3
    assert [bare(r) for r in feed(target, frames[8:])] == [bare(r) for r in feed(untouched, frames[8:])]


# Encodings


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_the_reduced_frame_gives_the_same_results(factor: int) -> None:
    config = camera(working_size_px=72)
    size = (factor * WIDTH, factor * HEIGHT)
    frames = [
        replace(one, data=np.kron(one.data, np.ones((factor, factor), np.uint8))) for one in scene(4, 8)
    ]
    frames = [replace(one, width=size[0], height=size[1]) for one in frames]
    reduce = Reducer(config)
    parts = [reduce(one) for one in frames]
    assert parts[0].crop is not None
    assert parts[0].reduction == (1, 2, 4)[(1, 2, 5).index(factor)]
    assert parts[0].data.size < frames[0].data.size / parts[0].reduction ** 2
    results = [bare(r) for r in feed(pipeline(config), parts)]
    assert results == [bare(r) for r in feed(pipeline(config), frames)]
    assert all(r.decided for r in results)


def test_the_luma_of_i420_gives_the_same_results_as_gray() -> None:
    chroma = np.random.default_rng(1).integers(0, 256, (HEIGHT // 2, WIDTH)).astype(np.uint8)
    frames = scene(4, 8)
    planes = [replace(one, encoding="i420", data=np.vstack([one.data, chroma])) for one in frames]
    assert [bare(r) for r in feed(pipeline(), planes)] == [bare(r) for r in feed(pipeline(), frames)]


# The alarm that it cannot see, and alarms of before a restart


def blind_changes(results: tuple[RoiResult, ...]) -> list[tuple[str, str | None]]:
    return [
        (one.transition.change.value, one.transition.reason)
        for result in results
        for one in result.changes
        if one.alarm_class is AlarmClass.BLIND
    ]


def test_blindness_that_lasts_is_an_alarm_of_its_own() -> None:
    target = pipeline()  # blind after 1 s, alarm after 5 s of that
    feed(target, scene(5, 0))  # the last at 0.4 s
    made = [(k / 10, *one) for k in range(15, 100) for one in blind_changes(target.poll(k / 10))]
    assert made == [(6.5, "raised", "no_stream")]
    result = target.poll(10.0)[0]
    assert (result.decision, result.blind_alarm.state) == (Decision.BLIND, AlarmState.UNACKNOWLEDGED)
    assert result.alarm.state is AlarmState.NORMAL
    result = target.acknowledge("apron", "Ada", 10.1, AlarmClass.BLIND)
    assert result.blind_alarm.state is AlarmState.ACKNOWLEDGED
    later = [blind_changes(target.process(frame(k), k / 10)) for k in range(102, 130)]
    assert [one for made in later for one in made] == [("cleared", None)]


def test_a_short_blindness_is_no_alarm() -> None:
    target = pipeline()
    feed(target, scene(5, 0))
    assert [one for k in range(15, 60) for one in blind_changes(target.poll(k / 10))] == []


def test_a_shelving_ends_by_itself_without_frames() -> None:
    target = pipeline()
    feed(target, scene(0, 20))
    shelved = target.apply(
        "apron",
        AlarmClass.LUMP,
        lambda alarm, rules, now_s: all_of(shelve(alarm, rules, now_s, "Ada", "dust", 3.0)),
        2.0,
    )
    assert (shelved.alarm.state, shelved.decision) == (AlarmState.SHELVED, Decision.LUMP)
    assert target.poll(4.9)[0].changes == ()
    (result,) = target.poll(5.0)
    assert [(one.transition.change, one.priority) for one in result.changes] == [
        (Change.UNSHELVED, "high"),
        (Change.RAISED, "high"),
    ]
    assert result.alarm.state is AlarmState.UNACKNOWLEDGED


def test_alarms_of_before_a_restart_go_on() -> None:
    waiting = Alarm(active=True, waits=True)
    alarms = {
        ("apron", AlarmClass.LUMP): waiting,
        ("apron", AlarmClass.BLIND): Alarm(waits=True),
        ("gone", AlarmClass.LUMP): waiting,
    }
    target = CameraPipeline(camera(), {"apron": prior()}, alarms=alarms)
    (result,) = target.poll(0.0)
    assert (result.alarm, result.blind_alarm.state) == (waiting, AlarmState.RETURNED)
    results = feed(target, scene(0, 30))
    assert results[-1].alarm.state is AlarmState.UNACKNOWLEDGED


# The alarm that it does not judge as well as it must


def system_changes(result: RoiResult) -> list[tuple[str, str | None]]:
    return [
        (one.transition.change.value, one.transition.reason)
        for one in result.changes
        if one.alarm_class is AlarmClass.SYSTEM
    ]


def test_a_trouble_is_an_alarm_and_another_one_announces_it_again() -> None:
    target = pipeline()
    feed(target, scene(5, 0))
    target.trouble("apron", Trouble.LATENCY, present=True)
    (result,) = target.poll(0.5)
    assert system_changes(result) == [("raised", "latency")]
    assert (result.decision, result.alarm.state) == (Decision.CLEAR, AlarmState.NORMAL)  # it still judges
    (result,) = target.poll(0.6)
    assert result.changes == ()
    result = target.acknowledge("apron", "Ada", 0.7, AlarmClass.SYSTEM)
    assert result.alarms[AlarmClass.SYSTEM].state is AlarmState.ACKNOWLEDGED
    target.trouble("apron", Trouble.PROOF_TEST, present=True)
    (result,) = target.poll(0.8)
    assert system_changes(result) == [("re_alarmed", "latency, proof_test")]
    assert result.alarms[AlarmClass.SYSTEM].state is AlarmState.UNACKNOWLEDGED
    target.trouble("apron", Trouble.PROOF_TEST, present=False)
    assert system_changes(target.poll(0.9)[0]) == []
    target.trouble("apron", Trouble.LATENCY, present=False)
    made = [(k / 10, *one) for k in range(10, 40) for one in system_changes(target.poll(k / 10)[0])]
    assert made == [(3.0, "cleared", None)]  # after 2 s without a trouble


def test_a_shelved_system_alarm_is_not_announced() -> None:
    target = pipeline()
    feed(target, scene(5, 0))
    target.apply(
        "apron",
        AlarmClass.SYSTEM,
        lambda alarm, rules, now_s: all_of(shelve(alarm, rules, now_s, "Ada", "slow network", 3.0)),
        0.4,
    )
    target.trouble("apron", Trouble.LATENCY, present=True)
    assert system_changes(target.poll(0.5)[0]) == [("active", "latency")]
    target.trouble("apron", Trouble.PROOF_TEST, present=True)
    assert system_changes(target.poll(0.6)[0]) == []
    assert system_changes(target.poll(3.4)[0]) == [("unshelved", "expired"), ("raised", None)]


class Broken(JdtDetector):
    """A filter that fails with priors of some age, as absurd contents make it."""

    def __init__(
        self, config: DetectorConfig, roi: Roi, learned: Learned | None, ages: list[Learned]
    ) -> None:
        super().__init__(config, roi, learned)  # type: ignore[arg-type]
        self._learned, self._ages = learned, ages

    def use(self, learned: Learned | None) -> None:
        super().use(learned)
        self._learned = learned

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        if any(self._learned is one for one in self._ages):
            raise FloatingPointError("overflow")
        return super().step(gray, colour, dt)


def test_a_prior_that_fails_in_use_gives_way_to_the_one_before_with_an_alarm() -> None:
    good, bad = prior(version=3), prior(version=4)
    assert good.learned is not bad.learned
    observer = Counting()
    made = CameraPipeline(
        camera(),
        {"apron": bad},
        older={"apron": good},
        observer=observer,
        make=lambda config, roi, learned: Broken(config, roi, learned, [bad.learned]),
    )
    results = [result for k in range(60) for result in made.process(frame(k), k / 10)]
    assert {result.prior for result in results[:4]} == {4}
    assert results[-1].prior == 3
    assert results[-1].decision is not Decision.BLIND
    assert observer.refused == {("apron", "failed"): 1}
    told = [c for r in results for c in r.changes if c.alarm_class is AlarmClass.SYSTEM]
    assert (told[0].transition.change, told[0].transition.reason) == (Change.RAISED, Trouble.PRIOR)
    made.use_prior("apron", prior(version=5))
    after = [result for k in range(60, 160) for result in made.process(frame(k), k / 10)]
    assert after[-1].prior == 5
    assert not after[-1].alarms[AlarmClass.SYSTEM].active


def test_where_nothing_can_stand_in_the_region_is_blind_and_the_filter_goes_on_trying() -> None:
    older, bad = prior(version=3), prior(version=4)
    both = [older.learned, bad.learned]
    made = CameraPipeline(
        camera(),
        {"apron": bad},
        older={"apron": older},
        make=lambda config, roi, learned: Broken(config, roi, learned, both),
    )
    results = [result for k in range(60) for result in made.process(frame(k), k / 10)]
    # With this likelihood there are no defaults: the prior stays, and once it works again the region sees again.
    assert (results[-1].decision, results[-1].reason) == (Decision.BLIND, BlindReason.FILTER)
    assert results[-1].alarms[AlarmClass.SYSTEM].active
    both.clear()
    later = [result for k in range(60, 160) for result in made.process(frame(k), k / 10)]
    assert (later[-1].decision, later[-1].reason) == (Decision.CLEAR, None)
