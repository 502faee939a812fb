"""Sizes in millimetres: from calibration and boxes to records and the alarm."""

from __future__ import annotations

from dataclasses import replace
from math import erf, log, sqrt
from typing import Any

import numpy as np
import pytest

from lumpwatch.models.plane import Measure, OnBelt
from lumpwatch.service.belt.geometry import make_plane
from lumpwatch.service.config import parse_config
from lumpwatch.service.config.calibration import CalibrationConfig
from lumpwatch.service.core.detection import DetectedObject, Detection, LipReason, LumpSize
from lumpwatch.service.detection.sizing import (
    MOST_INDEPENDENT,
    SETTLING_SPREAD,
    SHAPE_FACTOR,
    SHAPE_SPREAD,
    Sizer,
)
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.spec import FeedSpec
from tests.models.test_plane import silhouette, velocity

WIDTH, HEIGHT = 640, 480
GEOMETRY = Geometry.of(FeedSpec())
POINTS_MM = ((-1200.0, 500.0), (1200.0, 500.0), (1200.0, 5500.0), (-1200.0, 5500.0))


def relative(points_mm: Any) -> list[tuple[float, float]]:
    return [tuple(point) for point in (GEOMETRY.to_px(np.array(points_mm)) / (WIDTH, HEIGHT)).tolist()]


LIP = relative([(-900.0, 6000.0), (900.0, 6000.0)])


def calibration(**extra: Any) -> CalibrationConfig:
    return CalibrationConfig.model_validate(
        {"points": relative(POINTS_MM), "points_mm": POINTS_MM, "lip": LIP, "limit_mm": 600.0, **extra}
    )


def seen(y: float, diameter: float, number: int = 1, existence: float = 0.9) -> DetectedObject:
    """What a perfect filter says of a sphere at `y` on a belt of 0.6 m/s."""
    x0, y0, w, h = silhouette(0.0, y, diameter).tolist()
    vx, vy = velocity(0.0, y, diameter / 2, 600.0).tolist()
    return DetectedObject(
        number, x0 - w / 2, y0 - h / 2, w, h, 2.0, 2.0, existence, "belt",
        vx=vx, vy=vy, spread_w=3.0, spread_h=3.0, spread_v=4.0,
    )  # fmt: skip


def one(found: Detection) -> LumpSize:
    size = found.objects[0].size
    assert size is not None
    return size


def test_a_lump_on_the_belt_has_a_size_a_speed_and_a_time() -> None:
    size = one(Sizer(calibration(), WIDTH, HEIGHT).measure(Detection(0.9, (seen(3000, 800),)), 0.0))
    assert size.longest_mm == pytest.approx(800 * SHAPE_FACTOR, rel=0.02)
    assert size.equivalent_mm == pytest.approx(800, rel=0.02)
    assert size.low_mm is not None
    assert size.longest_mm is not None
    assert size.high_mm is not None
    assert size.low_mm < size.longest_mm < size.high_mm
    assert size.speed_m_s == pytest.approx(0.6, rel=0.02)
    assert size.distance_m == pytest.approx(2.6, abs=0.03)
    assert size.lip_s == pytest.approx(2.6 / 0.6, rel=0.03)


def test_the_probability_above_the_limit_is_that_of_a_log_normal() -> None:
    size = one(
        Sizer(calibration(limit_mm=900.0), WIDTH, HEIGHT).measure(Detection(0.9, (seen(3000, 800),)), 0.0)
    )
    assert size.longest_mm is not None
    assert size.high_mm is not None
    spread = log(size.high_mm / size.longest_mm) / 1.6449
    expected = 0.5 * (1 + erf(log(size.longest_mm / 900.0) / spread / sqrt(2)))
    assert size.over_limit == pytest.approx(expected, abs=1e-9)


def test_more_looks_make_the_interval_narrower_but_never_nothing() -> None:
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    widths = []
    for i in range(60):
        size = one(sizer.measure(Detection(0.9, (seen(2900 + 30 * i, 700),)), i / 15))
        assert size.high_mm is not None
        assert size.low_mm is not None
        widths.append(log(size.high_mm / size.low_mm))
    assert widths[30] < widths[0]
    assert widths[-1] > 2 * 1.6449 * SHAPE_SPREAD


def test_the_interval_of_a_new_box_is_wider_until_it_has_settled() -> None:
    """Measured at one place for ten seconds: what remains is the shape, and a measuring error seen four times."""
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    variances = []
    for second in range(11):
        size = one(sizer.measure(Detection(0.9, (seen(3000, 700),)), float(second)))
        assert size.high_mm is not None
        assert size.low_mm is not None
        variances.append((log(size.high_mm / size.low_mm) / (2 * 1.6449)) ** 2)
    measuring = variances[0] - SETTLING_SPREAD**2 - SHAPE_SPREAD**2
    assert measuring > 0
    assert variances[-1] == pytest.approx(SHAPE_SPREAD**2 + measuring / MOST_INDEPENDENT, rel=1e-3)


def test_a_lump_that_is_not_whole_in_the_picture_keeps_its_size() -> None:
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    first = one(sizer.measure(Detection(0.9, (seen(3000, 800),)), 0.0))
    cut = replace(seen(3000, 800), y=0.0, h=40.0)
    assert one(sizer.measure(Detection(0.9, (cut,)), 0.1)).longest_mm == first.longest_mm
    assert one(sizer.measure(Detection(0.9, (replace(cut, id=2),)), 0.2)).longest_mm is None


def test_what_has_no_size_yet_counts_as_too_large() -> None:
    cut = replace(seen(3000, 300), y=0.0, h=20.0)
    found = Sizer(calibration(), WIDTH, HEIGHT).measure(Detection(0.9, (cut,)), 0.0)
    assert found.oversize == pytest.approx(0.9)
    assert Sizer(calibration(), WIDTH, HEIGHT).measure(Detection(0.4, ()), 0.0).oversize == pytest.approx(0.4)


def test_what_is_first_seen_at_the_lip_comes_too_late_to_be_announced() -> None:
    """Nobody saw it whole before; one that was measured on its way keeps its size at the lip."""
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    at_the_lip = seen(5900, 1000)
    assert sizer.measure(Detection(0.9, (at_the_lip,)), 0.0).oversize == pytest.approx(0.0)
    sizer.measure(Detection(0.9, (seen(3000, 1000, 2),)), 1.0)
    assert sizer.measure(Detection(0.9, (replace(at_the_lip, id=2),)), 3.0).oversize == pytest.approx(0.9)


def test_a_small_rock_does_not_alarm_however_sure_it_is() -> None:
    found = Sizer(calibration(), WIDTH, HEIGHT).measure(
        Detection(0.999, (seen(3000, 250, existence=0.999),)), 0.0
    )
    assert found.existence == 0.999
    assert found.alarming == found.oversize
    assert found.alarming < 0.01


def test_without_a_limit_every_lump_alarms() -> None:
    found = Sizer(calibration(limit_mm=None), WIDTH, HEIGHT).measure(Detection(0.95, (seen(3000, 250),)), 0.0)
    assert found.alarming == pytest.approx(0.95)


def test_two_lumps_add_their_chances() -> None:
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    found = sizer.measure(Detection(0.99, (seen(2000, 1000, 1, 0.9), seen(4500, 1000, 2, 0.9))), 0.0)
    assert found.oversize == pytest.approx(1 - 0.1 * 0.1)


def test_a_lump_counts_from_the_configured_certainty_on() -> None:
    """Of two, one is rather above the limit and one rather below; sure of its size is neither."""
    above, below = (limit * 600.0 / SHAPE_FACTOR for limit in (1.06, 0.94))
    both = Detection(0.99, (seen(2000, above, 1, 0.9), seen(4500, below, 2, 0.8)))
    for certain, expected in ((0.05, 0.98), (0.5, 0.9), (0.95, 0.0)):
        found = Sizer(calibration(), WIDTH, HEIGHT, certain).measure(both, 0.0)
        over = [one.size.over_limit for one in found.objects if one.size]
        assert 0.5 < over[0] < 0.95
        assert 0.05 < over[1] < 0.5
        # Something that has no box yet (existence is a little more than that of both) has no size either.
        assert found.oversize == pytest.approx(1 - (1 - expected) * (0.01 / 0.02))


def test_an_object_is_forgotten_after_a_while() -> None:
    sizer = Sizer(calibration(), WIDTH, HEIGHT)
    sizer.measure(Detection(0.9, (seen(3000, 800),)), 0.0)
    sizer.measure(Detection(0.0, ()), 60.0)
    cut = replace(seen(3000, 800), y=0.0, h=40.0)
    assert one(sizer.measure(Detection(0.9, (cut,)), 60.1)).longest_mm is None


def test_a_known_width_at_two_rows_gives_the_same_plane() -> None:
    corners = relative(POINTS_MM)
    view = 2 * np.degrees(np.arctan(WIDTH / 2 / GEOMETRY.focal_px))
    by_width = calibration(
        points=(), points_mm=(),
        width={"far": corners[:2], "near": [corners[3], corners[2]], "width_mm": 2400.0, "view_deg": view},
    )  # fmt: skip
    assert make_plane(by_width, WIDTH, HEIGHT).cameras.focal[0] == pytest.approx(GEOMETRY.focal_px, rel=1e-6)
    sizes = [
        one(Sizer(config, WIDTH, HEIGHT).measure(Detection(0.9, (seen(3000, 800),)), 0.0))
        for config in (calibration(), by_width)
    ]
    assert sizes[0].longest_mm == pytest.approx(sizes[1].longest_mm)
    assert sizes[0].lip_s == pytest.approx(sizes[1].lip_s)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{lip: [[0, 1], [1, 1]]}", "either points with points_mm, or width"),
        (
            "{points: [[0, 0], [1, 0], [1, 1]], points_mm: [[0, 0], [1, 0], [1, 1]], lip: [[0, 1], [1, 1]]}",
            "four",
        ),
        (
            "{points: [[0, 0], [1, 0], [1, 1], [0, 1]], points_mm: [[0, 0]], lip: [[0, 1], [1, 1]]}",
            "4 points, but 1",
        ),
        (
            "{width: {far: [[0, 0], [1, 0]], near: [[0, 1], [1, 1]], width_mm: 9}, lip: [[0, 1], [1, 1]]}",
            "view_deg",
        ),
    ],
)
def test_what_the_configuration_refuses(text: str, message: str) -> None:
    site = f"""\
site: pit
cameras:
  - id: cam
    source: {{url: "sim:feed"}}
    rois: [{{id: apron, polygon: [[0, 0], [1, 0], [1, 1]], calibration: {text}}}]
"""
    with pytest.raises(ConfigError, match=message):
        parse_config(site)


def test_points_on_a_line_are_refused_with_the_first_frame() -> None:
    line = calibration(points=[(0.1, 0.5), (0.3, 0.5), (0.6, 0.5), (0.9, 0.5)])
    with pytest.raises(ConfigError, match="one line"):
        Sizer(line, WIDTH, HEIGHT)


# Seconds to the lip


@pytest.mark.parametrize(
    ("speed_m_s", "towards", "expected"),
    [
        # Surely moving: as it is seen.
        (None, Measure(0.6, 0.1), (5.0, None)),
        # Hardly known yet: weighed with the belt's 0.5 m/s, give or take a quarter.
        (0.5, Measure(0.62, 0.35), (3.0 / 0.5136, None)),
        (None, Measure(0.62, 0.35), (None, LipReason.UNCERTAIN)),
        # It stands, or runs back: the belt's speed does not help.
        (0.5, Measure(0.0, 0.01), (None, LipReason.NOT_MOVING)),
        (0.5, Measure(-0.4, 0.1), (None, LipReason.NOT_MOVING)),
    ],
)
def test_what_is_known_of_the_belt_tells_when_a_lump_just_found_arrives(
    speed_m_s: float | None, towards: Measure, expected: tuple[float | None, LipReason | None]
) -> None:
    config = CalibrationConfig.model_validate(
        {
            "points": [[0.32, 0.20], [0.68, 0.20], [0.84, 0.70], [0.16, 0.70]],
            "points_mm": [[0, 0], [2400, 0], [2400, 5000], [0, 5000]],
            "lip": [[0.15, 0.77], [0.85, 0.77]],
            "speed_m_s": speed_m_s,
            "error_px": 4.0,
        }
    )
    lip = Measure(3.0 / towards.value, 0.5) if towards.value > 2 * towards.spread else None
    one = Measure(500.0, 10.0)
    found = OnBelt(one, one, Measure(abs(towards.value), towards.spread), Measure(3.0, 0.1), towards, lip)
    lip_found, reason = Sizer(config, 1920, 1080)._lip(found)
    assert reason is expected[1]
    if expected[0] is None:
        assert lip_found is None
    else:
        assert lip_found is not None
        assert lip_found.value == pytest.approx(expected[0], rel=1e-3)
        assert lip_found.spread > 0.1
