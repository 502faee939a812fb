"""An insect on the lens is no lump: it does not count, hides the region, and keeps no lump from being announced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import CameraConfig, DetectorConfig
from lumpwatch.service.core.alarm import Change
from lumpwatch.service.core.decision import BlindReason, Decision, RoiResult
from lumpwatch.service.core.detection import DetectedObject, Detection, NotCounted
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from lumpwatch.service.detection.next_lump import NextLump

WIDTH, HEIGHT, FPS, SPEED = 160, 160, 12.5, 40.0
CAMERA = CameraConfig.model_validate(
    {
        "id": "cam",
        "source": {"url": "x.mp4"},
        "rois": [{"id": "apron", "polygon": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]}],
    }
)
Found = Callable[[float], dict[int, tuple[float, float]]]


def thing(number: int, x: float, y: float, existence: float = 0.9999) -> DetectedObject:
    return DetectedObject(number, x - 18, y - 16, 36, 32, 1, 1, existence, "belt", vy=SPEED)


class Scripted(JdtDetector):
    """Finds what the script says, at its time."""

    def __init__(self, config: DetectorConfig, roi: Roi, learned: Learned | None, found: Found) -> None:
        super().__init__(config, roi, learned)  # type: ignore[arg-type]
        self.now_s, self._found = 0.0, found

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        objects = tuple(thing(i, x, y) for i, (x, y) in self._found(self.now_s).items())
        self.now_s += 1 / FPS
        existence = 1.0 - float(np.prod([1.0 - one.existence for one in objects]))
        return Detection(existence, objects, effective_particles=100.0)


def run(found: Found, seconds: float) -> list[RoiResult]:
    """The belt rolls; what is found is drawn where it is found."""
    return run_with_picture(found, found, seconds)


def run_with_picture(shown: Found, found: Found, seconds: float) -> list[RoiResult]:
    """As `run`, but what is shown is there before it is found."""
    made: list[Scripted] = []

    def make(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
        made.append(Scripted(config, roi, learned, found))
        return made[-1]

    pipeline = CameraPipeline(CAMERA, {}, make=make)
    noise = np.random.default_rng(5).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    texture = np.asarray(110 + 40 * smooth / smooth.std(), np.float32)
    results: list[RoiResult] = []
    for k in range(round(seconds * FPS)):
        time_s = k / FPS
        picture = np.roll(texture, round(time_s * SPEED), axis=0)
        for x, y in shown(time_s).values():
            picture = _blot(picture, x, y)
        data = np.clip(picture, 0, 255).astype(np.uint8)
        results += pipeline.process(Frame(k, time_s, time_s, time_s, WIDTH, HEIGHT, "gray8", data), time_s)
    return results


def _blot(picture: NDArray[np.float32], x: float, y: float) -> NDArray[np.float32]:
    there = np.zeros_like(picture)
    cv2.ellipse(there, (round(x), round(y)), (16, 14), 0, 0, 360, 1.0, -1)
    soft = cv2.GaussianBlur(there, (0, 0), 2.0)
    return picture * (1 - soft) + 30 * soft


def changes(results: list[RoiResult]) -> list[tuple[str, Change, str | None]]:
    return [(c.alarm_class, c.transition.change, c.transition.reason) for r in results for c in r.changes]


def test_what_was_there_before_it_was_taken_for_a_lump_raises_nothing_and_hides_the_region() -> None:
    def insect(time_s: float) -> dict[int, tuple[float, float]]:
        return {1: (80.0, 80.0)}

    def late(time_s: float) -> dict[int, tuple[float, float]]:
        return insect(time_s) if time_s >= 3.0 else {}

    results = run_with_picture(insect, late, 8.0)
    assert not [c for c in changes(results) if c[0] == "lump"]
    assert results[-1].decision is Decision.BLIND
    assert results[-1].reason is BlindReason.HIDDEN
    assert results[-1].detection is not None
    (found,) = results[-1].detection.objects
    assert found.not_counted is NotCounted.STANDS
    assert results[-1].existence < 0.1


def test_an_insect_that_lands_is_told_from_a_lump_and_the_next_lump_is_announced() -> None:
    def both(time_s: float) -> dict[int, tuple[float, float]]:
        there = {1: (48.0, 80.0)} if time_s >= 2.5 else {}
        if time_s >= 7.0:
            there[2] = (120.0, 10.0 + SPEED * (time_s - 7.0))
        return there

    results = run(both, 9.5)
    told = [c for c in changes(results) if c[0] == "lump"]
    assert told[0][1] is Change.RAISED  # it may be one, until it is seen to stay
    assert told[1:] == [("lump", Change.RE_ALARMED, "another_lump")]
    (again,) = [
        c.transition.time_s for r in results for c in r.changes if c.transition.reason == "another_lump"
    ]
    assert 7.0 <= again <= 8.0
    assert results[-1].reason is BlindReason.HIDDEN
    before = [r for r in results if r.frame is not None and 5.6 < r.frame.capture_s < 7.0]
    assert {r.reason for r in before} == {BlindReason.HIDDEN}


def test_a_lump_that_rides_counts_and_is_announced_once() -> None:
    def lump(time_s: float) -> dict[int, tuple[float, float]]:
        return {1: (80.0, 20.0 + SPEED * (time_s - 3.0))} if 3.0 <= time_s < 6.0 else {}

    results = run(lump, 9.0)
    assert [c[:2] for c in changes(results)] == [("lump", Change.RAISED), ("lump", Change.CLEARED)]
    assert all(o.counts for r in results if r.detection is not None for o in r.detection.objects)


def test_the_next_lump_is_said_once_and_a_track_that_was_lost_is_no_next_one() -> None:
    following = NextLump()
    first = thing(1, 40, 40)
    following.raised(Detection(0.99, (first,)), 0.0)

    def comes(*objects: DetectedObject, time_s: float) -> bool:
        return following.comes(Detection(0.99, objects), time_s, 0.9, 0.6)

    assert not comes(first, time_s=0.1)
    assert not any(comes(thing(2, 42, 40 + SPEED * t), time_s=t) for t in (0.5, 1.0, 1.5))  # found again
    other = thing(3, 130, 20)
    assert [comes(replace(other, y=4 + SPEED * t), time_s=2 + t) for t in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)] == [
        False,
        False,
        False,
        True,
        False,
        False,
    ]
    unsure, standing = (
        thing(4, 90, 120, existence=0.7),
        replace(thing(5, 90, 120), not_counted=NotCounted.STANDS),
    )
    assert not any(comes(unsure, standing, time_s=4 + t) for t in (0.0, 0.5, 1.0))


def test_what_stands_takes_its_existence_along() -> None:
    insect, lump = thing(1, 40, 40, existence=0.99), thing(2, 100, 40, existence=0.7)
    both = Detection(1 - 0.01 * 0.3 * 0.9, (insect, lump))
    left = both.without((1,), NotCounted.STANDS)
    assert abs(left.existence - 0.73) < 1e-9
    assert both.without((), NotCounted.STANDS) is both
    sure = Detection(1.0, (replace(insect, existence=1.0),)).without((1,), NotCounted.STANDS)
    assert sure.existence == 0.0


def test_letters_over_the_belt_stand_however_boxes_jump_on_them() -> None:
    """Their place looks like the belt behind them, boxes jump to and fro, and tracks are lost and found again."""

    def boxes(time_s: float) -> dict[int, tuple[float, float]]:
        there = {10 + int(time_s / 2.2): (48.0, 80.0 + 8.0 * np.sin(7.0 * time_s))}
        if time_s >= 6.5:
            there[1] = (120.0, 10.0 + SPEED * (time_s - 6.5))
        return there

    results = run_with_picture(lambda _: {}, boxes, 8.0)
    told = [c for c in changes(results) if c[0] == "lump"]
    assert [c[1] for c in told] == [
        Change.RAISED,
        Change.RE_ALARMED,
    ]  # before it was known to stand, and the lump
    assert told[1][2] == "another_lump"
    known = [r for r in results if r.frame is not None and 4.8 < r.frame.capture_s < 6.5]
    assert {r.decision for r in known} == {Decision.BLIND}
    assert {o.not_counted for r in known if r.detection is not None for o in r.detection.objects} == {
        NotCounted.STANDS
    }


def test_what_is_there_when_the_service_starts_is_no_lump_for_good_and_hides_no_lump() -> None:
    def both(time_s: float) -> dict[int, tuple[float, float]]:
        there = {1: (48.0, 80.0)}
        if time_s >= 4.5:
            there[2] = (120.0, 10.0 + SPEED * (time_s - 4.5))
        return there

    results = run(both, 6.0)
    told = [c for c in changes(results) if c[0] == "lump"]
    assert told[-1][1:] in ((Change.RAISED, None), (Change.RE_ALARMED, "another_lump"))
    at = [c.transition.time_s for r in results for c in r.changes if c.alarm_class == "lump"]
    assert 4.5 <= at[-1] <= 5.9
    before = [r for r in results if r.frame is not None and 3.8 < r.frame.capture_s < 4.5]
    assert {r.reason for r in before} == {BlindReason.HIDDEN}
