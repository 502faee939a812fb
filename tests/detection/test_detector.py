"""From configuration and prior to a filter, and from a frame's planes to what the filter sees."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from lumpwatch.models.jdt.births import PolygonBirths
from lumpwatch.models.jdt.motion import Bounce, ConstantAcceleration, ConstantVelocity, RandomWalk
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching
from lumpwatch.models.roi import make_roi
from lumpwatch.service.config import JdtConfig
from lumpwatch.service.core.crop import working_colour, working_luma
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.detectors.filters import PriorMismatchError, make_filter, make_likelihood
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from tests.service_helpers import POLYGON, bright_fit, camera, frame, learned, lump_fit

ROI = make_roi(POLYGON, 96, 64, 320)
HEIGHT = 48.0  # of the ROI in working pixels


def config(**detector: Any) -> JdtConfig:
    made = camera(**detector).rois[0].detector
    assert isinstance(made, JdtConfig)
    return made


# Filters


def test_lumps_fall_fast_and_ride_slowly_by_default() -> None:
    made = make_filter(JdtConfig(), ROI, None)
    belt, fall = made.models
    assert isinstance(belt, ConstantAcceleration)
    assert isinstance(fall, ConstantAcceleration)
    assert belt.name == "belt"
    assert belt.rate == pytest.approx((0.0, 0.03 * HEIGHT))
    assert fall.name == "fall"
    assert fall.rate == pytest.approx((0.0, 3.0 * HEIGHT))
    assert isinstance(made.switching, FixedSwitching)
    assert made.switching.matrix == pytest.approx(np.array([[0.97, 0.03], [0.03, 0.97]]))
    assert isinstance(made.births, PolygonBirths)
    assert made.births.model_probabilities == pytest.approx([0.5, 0.5])


def test_what_is_configured_goes_before_what_is_learned() -> None:
    known = replace(
        learned(("a", "b")), rates=np.array([[0.1, 0.2], [0.3, 0.4]]), velocity_noise=np.array([0.5, 0.6])
    )
    models = [
        {"name": "a", "kind": "constant_acceleration", "acceleration_h_s2": [1, 2], "velocity_noise_h_s": 3},
        {"name": "b", "kind": "constant_acceleration"},
    ]
    a, b = make_filter(config(models=models), ROI, known).models
    assert isinstance(a, ConstantAcceleration)
    assert isinstance(b, ConstantAcceleration)
    assert a.rate == pytest.approx((1 * HEIGHT, 2 * HEIGHT))
    assert a.velocity_noise == pytest.approx(3 * HEIGHT)
    assert b.rate == pytest.approx((0.3 * HEIGHT, 0.4 * HEIGHT))
    assert b.velocity_noise == pytest.approx(0.6 * HEIGHT)


def test_a_bounce_is_never_born_and_never_stays() -> None:
    made = make_filter(config(models=["constant_velocity", "bounce_x", "random_walk"]), ROI, None)
    assert [type(model) for model in made.models] == [ConstantVelocity, Bounce, RandomWalk]
    assert isinstance(made.births, PolygonBirths)
    assert made.births.model_probabilities == pytest.approx([0.5, 0.0, 0.5])
    assert isinstance(made.switching, FixedSwitching)
    assert made.switching.matrix == pytest.approx(
        np.array([[0.97, 0.015, 0.015], [0.5, 0.0, 0.5], [0.015, 0.015, 0.97]])
    )


def test_one_model_stays_itself() -> None:
    made = make_filter(config(), ROI, None)
    assert isinstance(made.switching, FixedSwitching)
    assert made.switching.matrix == pytest.approx(np.ones((1, 1)))
    only_bounces = make_filter(config(models=["bounce_x", "bounce_y"]), ROI, None)
    assert isinstance(only_bounces.births, PolygonBirths)
    assert only_bounces.births.model_probabilities == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize(("switching", "kind"), [("adaptive", AdaptiveSwitching), ("fixed", FixedSwitching)])
def test_switching_is_learned(switching: str, kind: type) -> None:
    assert isinstance(make_filter(config(switching=switching), ROI, learned()).switching, kind)


def test_models_of_another_name_are_refused() -> None:
    with pytest.raises(PriorMismatchError, match=r"belt, .* constant_velocity"):
        make_filter(config(), ROI, learned(("belt",)))


@pytest.mark.parametrize(
    ("likelihood", "known", "reason"),
    [
        ({"kind": "lump"}, learned(), "holds a histogram"),
        ({"kind": "histogram"}, learned(likelihood=lump_fit()), "needs a trained prior"),
        ({"kind": "histogram"}, None, "needs a trained prior"),
        ({"kind": "histogram"}, learned(likelihood=bright_fit("colour")), "of colour, .* asks for luma"),
    ],
)
def test_a_likelihood_of_another_kind_is_refused(likelihood: dict[str, str], known: Any, reason: str) -> None:
    with pytest.raises(PriorMismatchError, match=reason):
        make_likelihood(config(likelihood=likelihood), known)


def test_the_detector_looks_at_colour_where_it_should() -> None:
    reference = np.full(16, 0.01 / 16)
    reference[0] += 0.99  # pure red
    red = replace(bright_fit("colour"), reference=reference)
    chosen = config(likelihood={"kind": "histogram", "channel": "colour"})
    gray = np.full(ROI.shape, 76, np.uint8)
    there, away = (np.full((*ROI.shape, 3), 60, np.uint8) for _ in range(2))
    there[17:31, 29:43] = (0, 0, 255)
    existences = []
    for picture in (there, away):
        detector = JdtDetector(chosen, ROI, learned(likelihood=red))
        for _ in range(15):
            told = detector.step(gray, picture, 0.1)
        existences.append(told.existence)
    assert existences[0] > 0.95
    assert existences[1] < 0.1


# Planes


def i420(bgr: np.ndarray[Any, np.dtype[np.uint8]]) -> Frame:
    planes = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420), np.uint8)
    return frame(0, data=planes, encoding="i420", size=(bgr.shape[1], bgr.shape[0]))


def colours(width: int, height: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Smooth colours, so that one chroma sample for four pixels loses little."""
    small = np.random.default_rng(3).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize(
    "polygon",
    [
        ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
        ((0.11, 0.13), (0.87, 0.13), (0.87, 0.91), (0.11, 0.91)),
        ((0.5, 0.21), (1.0, 0.6), (0.33, 1.0)),
    ],
)
@pytest.mark.parametrize("working_size", [1000, 50])
def test_the_cut_of_i420_is_that_of_the_whole_picture(
    polygon: tuple[tuple[float, float], ...], working_size: int
) -> None:
    bgr = colours(130, 98)
    planes = i420(bgr)
    roi = make_roi(polygon, 130, 98, working_size)
    whole = np.asarray(cv2.cvtColor(planes.data, cv2.COLOR_YUV2BGR_I420), np.uint8)
    difference = working_colour(planes, roi).astype(int) - roi.cut(whole)
    assert np.abs(difference).max() <= 2
    assert np.array_equal(working_luma(planes, roi), roi.cut(planes.data[:98]))


def test_colour_of_the_other_encodings() -> None:
    bgr = colours(96, 64)
    colour = frame(0, data=bgr, encoding="bgr8")
    assert np.array_equal(working_colour(colour, ROI), bgr[8:56, 12:84])
    expected = cv2.cvtColor(bgr[8:56, 12:84].copy(), cv2.COLOR_BGR2GRAY)
    assert np.array_equal(working_luma(colour, ROI), expected)
    gray = frame(0, bright=True)
    cut = working_luma(gray, ROI)
    assert np.array_equal(working_colour(gray, ROI), np.dstack([cut, cut, cut]))


@pytest.mark.parametrize("encoding", ["gray8", "i420", "bgr8"])
def test_a_part_that_does_not_cover_the_region_is_refused(encoding: Any) -> None:
    shape = {"gray8": (40, 40), "i420": (60, 40), "bgr8": (40, 40, 3)}[encoding]
    part = replace(frame(0), encoding=encoding, data=np.zeros(shape, np.uint8), crop=(30, 10, 40, 40))
    for cut in (working_luma, working_colour):
        with pytest.raises(ValueError, match="does not cover"):
            cut(part, ROI)
