"""The camera over a belt that a person has measured: never exact, and good enough all the same."""

from __future__ import annotations

from math import radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.belt_camera import Pose, best_poses, exact_pose, homography, misses, view_deg
from lumpwatch.models.plane import TOLERANCE, fit_plane, side_of

SIZE = (640, 480)
MIDDLE = np.array(SIZE) / 2.0


def camera(tilt_deg: float, height: float, view: float) -> Pose:
    """Looks along the belt's y, down by `tilt_deg`, at the middle of the belt."""
    tilt = radians(tilt_deg)
    forward = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    right = np.array([1.0, 0.0, 0.0])
    down = np.cross(forward, right)
    centre = -height / np.sin(tilt) * forward
    return Pose(320 / tan(radians(view) / 2), np.stack([right, down, forward], axis=1), centre)


def corners(seen_by: Pose, share: float = 0.35) -> np.ndarray:
    """A rectangle of the belt well within the picture."""
    w = share * float(np.linalg.norm(seen_by.centre)) * 320 / seen_by.focal
    return w * np.array([[-1.0, -1.2], [1, -1.2], [1, 1.2], [-1, 1.2]])


@given(st.floats(25, 89), st.floats(35, 90))
def test_an_exact_calibration_gives_its_camera(tilt: float, view: float) -> None:
    true = camera(tilt, 3000, view)
    places = corners(true)
    for found in (
        exact_pose(homography(places, true.project(places)), places.mean(axis=0)),
        best_poses(places, [true.project(places)], 0.01, SIZE[0])[0],
    ):
        assert found is not None
        assert misses(found, places, true.project(places)) < 0.02
        if tilt < 70:  # seen from straight above, the points hardly tell it
            assert view_deg(found.focal, SIZE[0]) == pytest.approx(view, abs=1.5)


@pytest.mark.parametrize("tilt", [40.0, 60.0, 88.0])
@pytest.mark.parametrize("view", [45.0, 60.0, 80.0])
def test_a_tape_that_is_off_by_some_per_cent_is_taken_and_sizes_hold(tilt: float, view: float) -> None:
    """Four corners, each measure off by 4 %, each point by 2 px: nine of ten sizes on the belt stay within 15 %."""
    true = camera(tilt, 3000, view)
    places = corners(true)
    lip = true.project(places[2:]) + MIDDLE
    exact = fit_plane(true.project(places) + MIDDLE, places, 2.0, SIZE, lip)
    middle = MIDDLE[None]
    off = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = true.project(places) + MIDDLE + 2.0 * rng.standard_normal(places.shape)
        told = places * (1 + 0.04 * rng.standard_normal(places.shape))
        found = fit_plane(points, told, 2.0, SIZE, lip)
        off.append(abs(side_of(found, middle, 400.0)[0] / side_of(exact, middle, 400.0)[0] - 1))
        assert found.missed_px <= TOLERANCE * 2.0
        assert 4.0 < found.view_deg < 150.0
    assert np.quantile(off, 0.9) <= 0.15
    assert max(off) <= 0.4


def test_what_cannot_be_meant_is_refused_with_how_far_it_is_off() -> None:
    true = camera(45, 3000, 60)
    places = corners(true)
    points = true.project(places) + MIDDLE
    crossed = points[[0, 2, 1, 3]]
    with pytest.raises(ValueError, match=r"\d px"):
        fit_plane(crossed, places, 2.0, SIZE, points[2:])


def test_a_larger_stated_error_takes_more() -> None:
    true = camera(45, 3000, 60)
    places = corners(true)
    points = true.project(places) + MIDDLE
    bent = points + np.array([[0.0, 0], [60, 0], [0, 0], [0, 90]])
    with pytest.raises(ValueError, match="error_px"):
        fit_plane(bent, places, 2.0, SIZE, points[2:])
    taken = fit_plane(bent, places, 20.0, SIZE, points[2:])
    assert 2.0 < taken.missed_px < 80.0
