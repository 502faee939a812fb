"""The belt's plane, against a pinhole camera whose spheres are projected point by point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.plane import BeltPlane, fit_plane, measure, side_of
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.spec import FeedSpec

SIZE = (640, 480)
GEOMETRY = Geometry.of(FeedSpec())
POINTS_MM = np.array([[-1200.0, 500], [1200, 500], [1200, 5500], [-1200, 5500], [0, 3000]])
LIP_MM = np.array([[-1200.0, 6000], [1200, 6000]])
ERRORS = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0])


def plane(error_px: float = 1.0, moved: float = 0.0, seed: int = 0) -> BeltPlane:
    points = GEOMETRY.to_px(POINTS_MM)
    points = points + moved * np.random.default_rng(seed).standard_normal(points.shape)
    return fit_plane(points, POINTS_MM, error_px, SIZE, GEOMETRY.to_px(LIP_MM))


PLANE = plane()


def silhouette(x: float, y: float, diameter: float) -> np.ndarray:
    """Box of a sphere on the belt, from points all over it."""
    r = diameter / 2
    polar, around = np.meshgrid(np.linspace(0, np.pi, 50), np.linspace(0, 2 * np.pi, 100))
    points = np.stack(
        [
            x + r * np.sin(polar) * np.cos(around),
            y + r * np.sin(polar) * np.sin(around),
            r + r * np.cos(polar),
        ],
        axis=-1,
    ).reshape(-1, 3)
    seen = np.array([GEOMETRY.project(*point)[:2] for point in points])
    low, high = seen.min(axis=0), seen.max(axis=0)
    return np.concatenate([(low + high) / 2, high - low])


def velocity(x: float, y: float, radius: float, speed: float) -> np.ndarray:
    """px/s of a centre that rides with the belt, mm/s."""
    here, there = (GEOMETRY.project(x, y + way, radius)[:2] for way in (0.0, speed * 1e-3))
    return (np.array(there) - here) / 1e-3


def test_the_camera_is_found_again() -> None:
    cameras = PLANE.cameras
    assert cameras.focal[0] == pytest.approx(GEOMETRY.focal_px, rel=1e-6)
    assert len(cameras.focal) == 1 + POINTS_MM.size


@settings(max_examples=40)
@given(st.floats(-800, 800), st.floats(900, 5200), st.floats(150, 1100), st.floats(100, 2000))
def test_a_sphere_on_the_belt_is_measured(x: float, y: float, diameter: float, speed: float) -> None:
    found = measure(PLANE, silhouette(x, y, diameter), velocity(x, y, diameter / 2, speed), ERRORS)
    assert found is not None
    assert found.equivalent_mm.value == pytest.approx(diameter, rel=0.01)
    assert found.longest_mm.value == pytest.approx(diameter, rel=0.04)  # a silhouette is not quite round
    assert found.speed_m_s.value == pytest.approx(speed / 1000, rel=0.02)
    left = 6000 - y - diameter / 2
    assert found.distance_m.value == pytest.approx(left / 1000, abs=0.03)
    if found.lip_s is not None:
        assert found.lip_s.value == pytest.approx(left / speed, rel=0.03, abs=0.05)


@settings(max_examples=40)
@given(st.floats(-800, 800), st.floats(900, 5200), st.floats(150, 1100))
def test_a_sphere_covers_a_box_of_that_side(x: float, y: float, diameter: float) -> None:
    box = silhouette(x, y, diameter)
    assert side_of(PLANE, box[None, :2], diameter)[0] == pytest.approx(np.sqrt(box[2] * box[3]), rel=0.01)


def test_no_side_where_there_is_no_belt_or_no_room_under_the_camera() -> None:
    points = np.array([[320.0, 240.0], [320.0, -1e5]])
    assert np.isfinite(side_of(PLANE, points, 500.0)).tolist() == [True, False]
    assert np.isnan(side_of(PLANE, points[:1], 1e6)).all()


def test_errors_of_points_and_boxes_are_carried_through() -> None:
    """The stated spread is that of repeated calibrations and boxes with just those errors."""
    box, moving = silhouette(300, 3000, 800), velocity(300, 3000, 400, 600)
    stated = measure(plane(2.0), box, moving, ERRORS)
    assert stated is not None
    rng = np.random.default_rng(5)
    seen = []
    for seed in range(150):
        noise = ERRORS * rng.standard_normal(6)
        one = measure(plane(2.0, moved=2.0, seed=seed), box + noise[:4], moving + noise[4:], ERRORS)
        assert one is not None
        seen.append([one.equivalent_mm.value, one.speed_m_s.value, one.distance_m.value])
    spread = np.std(seen, axis=0)
    told = [stated.equivalent_mm.spread, stated.speed_m_s.spread, stated.distance_m.spread]
    assert told == pytest.approx(spread, rel=0.15)


def test_an_ellipse_has_a_longest_diameter() -> None:
    box = silhouette(0, 3000, 600)
    long = measure(PLANE, box * (1, 1, 1.5, 1 / 1.5), np.zeros(2), ERRORS)
    round_ = measure(PLANE, box, np.zeros(2), ERRORS)
    assert long is not None
    assert round_ is not None
    assert long.equivalent_mm.value == pytest.approx(round_.equivalent_mm.value)
    assert long.longest_mm.value == pytest.approx(1.5 * round_.equivalent_mm.value, rel=0.04)


def test_what_stands_or_goes_back_never_reaches_the_lip() -> None:
    box = silhouette(0, 3000, 600)
    for speed in (0.0, -600.0):
        found = measure(PLANE, box, velocity(0, 3000, 300, speed), ERRORS)
        assert found is not None
        assert found.lip_s is None


def test_beyond_the_lip_the_distance_is_negative() -> None:
    found = measure(PLANE, silhouette(0, 6500, 600), np.zeros(2), ERRORS)
    assert found is not None
    assert found.distance_m.value == pytest.approx(-0.8, abs=0.03)


@pytest.mark.parametrize(("x", "y"), [(1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_the_axes_of_the_belt_may_point_anywhere(x: float, y: float) -> None:
    points = GEOMETRY.to_px(POINTS_MM)
    turned = fit_plane(points, POINTS_MM * (x, y), 1.0, SIZE, GEOMETRY.to_px(LIP_MM))
    found = measure(turned, silhouette(300, 3000, 800), velocity(300, 3000, 400, 600), ERRORS)
    assert found is not None
    assert found.equivalent_mm.value == pytest.approx(800, rel=0.01)
    assert found.distance_m.value == pytest.approx(2.6, abs=0.03)
    assert found.lip_s is not None
    assert found.lip_s.value == pytest.approx(2.6 / 0.6, rel=0.02)


def test_above_the_horizon_there_is_no_belt() -> None:
    assert measure(PLANE, np.array([320.0, -5000.0, 40, 40]), np.zeros(2), ERRORS) is None


@pytest.mark.parametrize(
    ("px", "mm", "error", "lip", "message"),
    [
        (POINTS_MM[:3], POINTS_MM[:3], 1.0, LIP_MM, "4 points"),
        (POINTS_MM, POINTS_MM[:4], 1.0, LIP_MM, "as many"),
        (POINTS_MM, POINTS_MM, 0.0, LIP_MM, "positive"),
        ([[0, 0], [1, 0], [2, 0], [3, 0]], POINTS_MM[:4], 1.0, LIP_MM, "one line"),
        (GEOMETRY.to_px(POINTS_MM[:4])[[0, 2, 1, 3]], POINTS_MM[:4], 1.0, LIP_MM, "order"),
    ],
)
def test_what_is_no_calibration(px: object, mm: object, error: float, lip: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_plane(np.array(px, float), np.array(mm, float), error, SIZE, np.array(lip, float))


def test_a_lip_needs_two_points() -> None:
    end = GEOMETRY.to_px(LIP_MM)[0]
    with pytest.raises(ValueError, match="the same"):
        fit_plane(GEOMETRY.to_px(POINTS_MM), POINTS_MM, 1.0, SIZE, np.stack([end, end]))
