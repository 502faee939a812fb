"""The trackers as detectors of a ROI."""

from __future__ import annotations

from itertools import islice
from typing import Any

import cv2
import numpy as np
import pytest

from lumpwatch.models.evaluation import evaluate, tracks_of, without_ignored
from lumpwatch.models.roi import make_roi
from lumpwatch.service.config import ImmPfConfig, JpdaConfig, parse_config
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.detection.detectors.filters import PriorMismatchError
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.detectors.trackers import TrackerDetector
from lumpwatch.service.errors import ConfigError
from tests import street
from tests.service_helpers import learned

WHOLE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
KINDS = ("imm_pf", "jpda")
FAST: dict[str, Any] = {"foreground": {"kind": "mixture"}, "size_h": [0.08, 0.4]}


def made(kind: str, polygon: Any = WHOLE, prior: Any = None, **extra: Any) -> TrackerDetector:
    models: Any = {"imm_pf": ImmPfConfig, "jpda": JpdaConfig}
    config = models[kind].model_validate({"kind": kind, **FAST, **extra})
    detector = make_detector(config, make_roi(polygon, street.WIDTH, street.HEIGHT, 320), prior)
    assert isinstance(detector, TrackerDetector)
    return detector


def run(detector: TrackerDetector, seconds: float, first_s: float = 0.0) -> list[Detection]:
    found = []
    for picture in islice(street.pictures(seconds), round(first_s * street.FPS), None):
        cut = detector.roi.cut(picture)
        found.append(
            detector.step(np.asarray(cv2.cvtColor(cut, cv2.COLOR_BGR2GRAY), np.uint8), cut, 1 / street.FPS)
        )
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_there_until_something_moves(kind: str) -> None:
    found = run(made(kind), street.EMPTY_S + 3.0)
    before = round(street.EMPTY_S * street.FPS)
    assert all(one.existence < 0.5 and not one.objects for one in found[:before])
    assert found[-1].existence > 0.9
    assert len(found[-1].objects) == 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "foreground",
    [
        {"kind": "mixture", "memory_s": 2.0},
        {"kind": "statistical", "learning_rate": 0.2, "initial_frames": 20, "once_off_share": 0.6},
    ],
    ids=["mixture", "statistical"],
)
def test_what_covers_the_lens_does_not_become_background(kind: str, foreground: dict[str, Any]) -> None:
    empty = next(iter(street.pictures(1.0)))
    cover = np.full_like(empty, 200)
    seen = {}
    for learns in (True, False):
        detector = made(kind, foreground=foreground, size_h=[0.9, 1.2])

        def show(picture: Any, count: int, detector: TrackerDetector = detector) -> None:
            cut = detector.roi.cut(picture)
            for _ in range(count):
                detector.step(cut[..., 0].copy(), cut, 1 / street.FPS)

        show(empty, 60)
        detector.learns = learns
        show(cover, 160)
        detector.learns = False
        mask = detector._foreground.apply(detector.roi.cut(cover))
        seen[learns] = float((mask > 0).mean())
    assert seen[True] < 0.01 < 0.9 < seen[False]


@pytest.mark.parametrize("kind", KINDS)
def test_boxes_are_in_frame_pixels_and_ids_stay(kind: str) -> None:
    found = run(made(kind), street.EMPTY_S + 3.0)[-15:]
    ids = [sorted(one.id for one in frame.objects) for frame in found]
    assert len(ids[0]) == 2
    assert all(one == ids[0] for one in ids)
    way = (3.0 - 1 / street.FPS) * street.SPEED
    rows = {row: (way - street.SIDE if sign > 0 else street.WIDTH - way) for row, sign, _ in street.LANES}
    for one in found[-1].objects:
        row = min(rows, key=lambda row: abs(row - (one.y + one.h / 2)))
        assert one.y + one.h / 2 == pytest.approx(row, abs=8)
        assert one.x + one.w / 2 == pytest.approx(rows[row] + street.SIDE / 2, abs=10)


@pytest.mark.parametrize("kind", KINDS)
def test_outside_the_polygon_nothing_is_seen(kind: str) -> None:
    upper = ((0.0, 0.0), (1.0, 0.0), (1.0, 0.55), (0.0, 0.55))
    found = run(made(kind, upper, size_h=[0.2, 0.4]), street.EMPTY_S + 3.0)
    assert [len(frame.objects) for frame in found[-15:]] == [1] * 15


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_too_small_or_too_large_does_not_count(kind: str) -> None:
    # A particle filter's boxes have the expected size: it takes a large object for several small ones.
    for sizes in ([0.5, 0.9], *([[0.01, 0.05]] if kind == "jpda" else [])):
        assert run(made(kind, size_h=sizes), street.EMPTY_S + 3.0)[-1].existence < 0.5


@pytest.mark.parametrize(("size_h", "why"), [([0.5, 0.9], "too_small"), ([0.01, 0.05], "too_large")])
def test_what_does_not_count_is_listed_and_says_why(size_h: list[float], why: str) -> None:
    last = run(made("jpda", size_h=size_h), street.EMPTY_S + 3.0)[-1]
    assert [found.not_counted for found in last.objects] == [why, why]
    assert last.existence == 0.0
    assert not last.counted


@pytest.mark.parametrize("side", [20, 44, 72])
def test_with_defaults_vehicles_of_any_size_are_shown(side: int) -> None:
    """0.08 to 0.3 of the picture's height."""
    seconds = street.EMPTY_S + 6.0
    lanes = ((60, 1.0, (40, 60, 210)), (180, -1.0, (200, 140, 30)))
    roi = make_roi(WHOLE, street.WIDTH, street.HEIGHT, 320)
    detector = make_detector(JpdaConfig(kind="jpda"), roi, None)
    rows = []
    for frame, picture in enumerate(street.pictures(seconds, 1, lanes, side), 1):
        found = detector.step(np.zeros(picture.shape[:2], np.uint8), picture, 1 / street.FPS)
        found = found.within(0, 0, street.WIDTH, street.HEIGHT)
        rows += [(frame, one.id, (one.x, one.y, one.w, one.h), one.counts) for one in found.objects]
    table = np.loadtxt(street.labels(seconds, lanes, side).splitlines(), delimiter=",")
    truth, hardly = (
        tracks_of(part[:, 0], part[:, 1], part[:, 2:6])
        for part in (table[table[:, 6] == 1], table[table[:, 6] == 0])
    )
    frames, ids, boxes, counts = zip(*rows, strict=True)
    scores = evaluate(without_ignored(tracks_of(frames, ids, boxes), truth, hardly, 0.5), truth, 0.5)
    assert all(counts)
    assert scores.precision >= 0.98
    assert scores.recall >= 0.95


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_pictures_give_the_same_detections(kind: str) -> None:
    assert run(made(kind), street.EMPTY_S + 1.0) == run(made(kind), street.EMPTY_S + 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_after_a_long_gap_or_a_new_prior_the_ids_are_new(kind: str) -> None:
    detector = made(kind)
    seen = {one.id for frame in run(detector, street.EMPTY_S + 3.0) for one in frame.objects}
    detector.use(None)
    again = {
        one.id for frame in run(detector, street.EMPTY_S + 4.0, street.EMPTY_S + 3.0) for one in frame.objects
    }
    assert again
    assert not again & seen
    picture = next(street.pictures(1.0))
    late = detector.step(picture[..., 0], picture, 10.0)
    assert late.existence < 0.5


def test_model_shares_are_probabilities_by_name() -> None:
    for one in run(made("imm_pf"), street.EMPTY_S + 3.0)[-1].objects:
        names, shares = zip(*one.model_shares, strict=True)
        assert names == ("position", "velocity", "acceleration")
        assert sum(shares) == pytest.approx(1.0)
        assert one.model == names[int(np.argmax(shares))]


def test_the_wrong_way_is_flagged_and_the_right_one_is_not() -> None:
    found = run(made("jpda", one_way={"direction": [1, 0]}), street.EMPTY_S + 3.0)[-1].objects
    flagged = {round(one.y + one.h / 2, -1): one.wrong_way for one in found}
    assert flagged == {90: False, 170: True}


def test_both_background_models_serve() -> None:
    found = run(made("jpda", foreground={"kind": "statistical", "initial_frames": 20}), street.EMPTY_S + 3.0)
    assert len(found[-1].objects) == 2


@pytest.mark.parametrize("kind", KINDS)
def test_without_colour_nothing_can_be_tracked(kind: str) -> None:
    with pytest.raises(ValueError, match="colour"):
        made(kind).step(np.zeros((240, 320), np.uint8), None, 0.1)


def test_a_prior_of_other_models_is_refused_and_the_tracker_goes_on() -> None:
    detector = made("imm_pf")
    with pytest.raises(PriorMismatchError, match="belt"):
        detector.use(learned(("belt", "fall")))
    assert run(detector, street.EMPTY_S + 3.0)[-1].existence > 0.9


def test_learned_sizes_decide_what_counts() -> None:
    assert run(made("jpda", prior=learned(("velocity",))), street.EMPTY_S + 3.0)[-1].existence < 0.5


@pytest.mark.parametrize(
    ("detector", "message"),
    [
        ("{kind: jpda, model: bounce_x}", r"detector: model: .* bounce_x"),
        ("{kind: jpda, one_way: {direction: [0, 0]}}", r"one_way: direction must have a length"),
        ("{kind: jpda, entries: [[[0, 0], [1, 1]]]}", r"detector.entries\[0\]"),
        ("{kind: imm_pf, models: [constant_velocity, constant_velocity]}", "given more than once"),
        ("{kind: imm_pf, least_model_share: 0.5}", "too large for 3 models"),
        ("{kind: imm_pf, particles: 5}", "detector.particles: .*20"),
        ("{kind: kalman}", "jdt, imm_pf or jpda"),
        ("{kind: jpda, foreground: {kind: median}}", "detector.foreground"),
    ],
)
def test_what_the_configuration_refuses(detector: str, message: str) -> None:
    text = f"""\
site: pit
cameras:
  - id: cam
    source: {{url: "sim:feed"}}
    rois: [{{id: apron, polygon: [[0, 0], [1, 0], [1, 1]], detector: {detector}}}]
"""
    with pytest.raises(ConfigError, match=message):
        parse_config(text)
