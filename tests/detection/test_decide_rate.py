"""How often a region is decided on: the same alarms at any rate, the same frames live and in replay, no false loss."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from typing import Any

import pytest

from lumpwatch.service.belt import camera_pace, decide_hz, never_clear
from lumpwatch.service.capture.camera_process import Reducer
from lumpwatch.service.config import CalibrationConfig, CameraConfig, RoiConfig, SightConfig
from lumpwatch.service.core.decision import BlindReason, RoiResult
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.observer import Unobserved
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.evidence.state_file import decode_state, encode_state
from tests.service_helpers import camera, frame, prior, site, site_tree

FPS = 30.0
RATES = (5.0, 6.0, 7.5, 10.0, 15.0, 30.0)


def at(rate: float | str | None, config: CameraConfig | None = None, **changed: Any) -> CameraConfig:
    config = config or camera()
    rois = tuple(roi.model_copy(update={"decide_hz": rate}) for roi in config.rois)
    return config.model_copy(update={"rois": rois, **changed})


class Paced(Unobserved):
    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def paced(self, roi: str) -> None:
        self.counts[roi] += 1


def run(
    config: CameraConfig, seconds: float = 10.0, fps: float = FPS
) -> tuple[list[RoiResult], Counter[str]]:
    """A square that is there from 2 s to 5 s, and again from 6.7 s to 8.7 s."""
    seen = Paced()
    pipeline = CameraPipeline(config, {roi.id: prior(roi=roi.id) for roi in config.rois}, observer=seen)
    results: list[RoiResult] = []
    for k in range(round(fps * seconds)):
        time_s = k / fps
        bright = 2.0 <= time_s < 5.0 or 6.7 <= time_s < 8.7
        results += pipeline.process(frame(k, bright=bright, time_s=time_s), time_s)
    return results, seen.counts


def changes(results: list[RoiResult]) -> list[tuple[str, float]]:
    return [(r.transition.change.value, r.transition.time_s) for r in results if r.transition]


@pytest.mark.parametrize("rate", RATES)
def test_alarms_are_the_same_within_a_period(rate: float) -> None:
    every, _ = run(at("all"))
    paced, counts = run(at(rate))
    assert len(paced) == len(every)  # a line for each frame all the same
    assert counts["apron"] == len(every) - sum(r.decided for r in paced)
    assert sum(r.decided for r in paced) == pytest.approx(10.0 * rate, abs=2)
    expected, found = changes(every), changes(paced)
    assert [change for change, _ in found] == [change for change, _ in expected] == ["raised", "cleared"] * 2
    # A delay that is no multiple of the period ends with the next frame.
    rounding = {
        "raised": math.ceil(0.2 * rate - 1e-9) / rate - 0.2,
        "cleared": math.ceil(0.3 * rate - 1e-9) / rate - 0.3,
    }
    for (change, then), (_, now) in zip(expected, found, strict=True):
        assert abs(now - then) <= 1 / rate + rounding[change] + 1 / FPS + 1e-6


def test_what_stands_between_frames_is_what_was_decided() -> None:
    paced, _ = run(at(10.0), seconds=4.0)
    for before, after in pairwise(paced):
        if not after.decided:
            assert (after.existence, after.decision, after.changes) == (before.existence, before.decision, ())
            assert after.frame is not None
            assert before.frame is not None
            assert after.frame.seq == before.frame.seq + 1


def two_regions() -> CameraConfig:
    tree = site_tree()
    (first,) = tree["cameras"][0]["rois"]
    tree["cameras"][0]["rois"] = [first | {"decide_hz": 15.0}, first | {"id": "chute", "decide_hz": 5.0}]
    return site(tree).cameras[0]


@pytest.mark.parametrize("fps", [25.0, 30.0])
def test_live_decides_on_the_frames_that_a_replay_decides_on(fps: float) -> None:
    config = two_regions()
    replayed, _ = run(config, 4.0, fps)
    sender = Reducer(config)
    pipeline = CameraPipeline(config, {roi.id: prior(roi=roi.id) for roi in config.rois})
    live: list[RoiResult] = []
    sent = 0
    for k in range(round(fps * 4.0)):
        one = frame(k, bright=k / fps >= 2.0, time_s=k / fps)
        if sender.is_due(one):
            sent += 1
            live += pipeline.process(sender(one), one.capture_s)

    def judged(results: list[RoiResult]) -> list[tuple[str, int, float]]:
        return [(r.roi, r.frame.seq, r.existence) for r in results if r.decided and r.frame]

    assert judged(live) == judged(replayed)
    assert sent == sum(r.decided for r in replayed if r.roi == "apron")


def test_frames_that_are_passed_over_are_no_overload() -> None:
    config = camera()
    quality = config.quality.model_copy(update={"enabled": True})
    config = at(10.0, config.model_copy(update={"quality": quality}))
    found = {result.reason for result in run(config, 13.0, fps=60.0)[0]}
    assert BlindReason.OVERLOAD not in found
    # Every eighth of those that are due is: six of seven were lost.
    pipeline = CameraPipeline(config, {"apron": prior()})
    said = set()
    for k in range(0, 16 * 60, 48):
        said |= {r.reason for r in pipeline.process(frame(k, time_s=k / 60.0), k / 60.0)}
    assert BlindReason.OVERLOAD in said


# How often


def calibrated(speed_m_s: float | None, **changed: Any) -> RoiConfig:
    """A belt 1.2 m wide and some 2.6 m long, seen from above."""
    belt = CalibrationConfig(
        points=((0.3, 0.1), (0.7, 0.1), (0.8, 0.9), (0.2, 0.9)),
        points_mm=((0.0, 0.0), (1200.0, 0.0), (1200.0, 2600.0), (0.0, 2600.0)),
        lip=((0.2, 0.9), (0.8, 0.9)),
        speed_m_s=speed_m_s,
    )
    polygon = ((0.3, 0.1), (0.7, 0.1), (0.8, 0.9), (0.2, 0.9))
    alarm = {"on_delay_s": 0.2}
    return RoiConfig.model_validate(
        {"id": "apron", "polygon": polygon, "calibration": belt, "alarm": alarm} | changed
    )


@pytest.mark.parametrize(
    ("speed_m_s", "expected"), [(None, 10.0), (0.1, 10.0), (0.3, 10.0), (0.8, 19.5), (1.5, 75.0), (3.0, None)]
)
def test_a_fast_belt_is_looked_at_more_often(speed_m_s: float | None, expected: float | None) -> None:
    found = decide_hz(calibrated(speed_m_s), SightConfig(), 640, 480)
    assert found == (expected if expected is None else pytest.approx(expected, rel=0.1))


def test_the_warning_that_is_asked_leaves_less_time() -> None:
    asked = calibrated(0.8, proof_test={"least_warning_s": 2.5})
    rate = decide_hz(asked, SightConfig(), 640, 480)
    assert rate is not None
    assert rate > 50.0


def test_a_rate_that_leaves_too_few_frames_in_a_ride_is_told() -> None:
    for roi, told in (
        (calibrated(1.5, decide_hz=10.0), "decide_hz (10) gives 17 frames"),  # 2.6 m at 1.5 m/s
        (calibrated(1.5, decide_hz=15.0), None),
        (calibrated(1.5), None),
        (calibrated(None, decide_hz=5.0), None),
    ):
        why = never_clear(roi, SightConfig(), 640, 480)
        assert why is None if told is None else why is not None and why.startswith(told)


def test_what_reads_by_frames_is_shown_every_frame() -> None:
    polygon = ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9))
    for detector in (
        {"kind": "jpda", "foreground": {"kind": "mixture"}},
        {"kind": "jdt", "likelihood": {"kind": "lump", "evidence": 0.3}},
    ):
        roi = RoiConfig.model_validate({"id": "a", "polygon": polygon, "detector": detector})
        assert decide_hz(roi, SightConfig(), 640, 480) is None
        slow = roi.model_copy(update={"decide_hz": 8.0})
        assert decide_hz(slow, SightConfig(), 640, 480) == 8.0


def test_a_camera_is_read_as_often_as_its_fastest_region() -> None:
    assert camera_pace(two_regions(), 96, 64).rate_hz == 15.0
    assert camera_pace(at("all", two_regions()), 96, 64).rate_hz is None


def test_a_rate_at_which_nothing_is_ever_clear_is_refused() -> None:
    tree = site_tree()
    tree["cameras"][0]["sight"] = {}
    tree["cameras"][0]["rois"][0]["decide_hz"] = 4.0
    with pytest.raises(ConfigError, match=r"decide_hz \(4\) is too seldom for CLEAR"):
        site(tree)


@pytest.mark.parametrize("first", range(40, 48))
def test_a_pipeline_that_goes_on_from_a_stored_state_takes_the_same_frames(first: int) -> None:
    """The camera's own choice goes into the state: a region sees only what that lets through."""
    config = at(10.0)

    def taken(pipeline: CameraPipeline, frames: range) -> list[bool]:
        return [pipeline.process(frame(k, time_s=k / FPS), k / FPS)[0].decided for k in frames]

    live = CameraPipeline(config, {"apron": prior()})
    taken(live, range(first))
    stored = encode_state(live.snapshots()["apron"])
    again = CameraPipeline(config, {"apron": prior()})
    again.restore("apron", decode_state(stored, "state", prior()))
    following = range(first, first + 12)
    assert taken(again, following) == taken(live, following)
