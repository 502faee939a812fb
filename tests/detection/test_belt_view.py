"""What a calibration means: figures against a camera that is known, and belts that cannot be."""

from __future__ import annotations

from math import radians, tan
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.plane import on_belt, to_picture
from lumpwatch.service.belt.geometry import make_plane, pixels_of
from lumpwatch.service.config import CalibrationConfig
from lumpwatch.service.detection.belt_view import BeltView, draw_belt, seen_belt

SIZE = (640, 480)
WIDTH: dict[str, Any] = {
    "far": [[0.32, 0.20], [0.68, 0.20]], "near": [[0.16, 0.70], [0.84, 0.70]], "width_mm": 2400, "view_deg": 58,
}  # fmt: skip
LIP = [[0.15, 0.77], [0.85, 0.77]]


def calibration(lip: Any = LIP, limit_mm: float | None = 600, **width: Any) -> CalibrationConfig:
    return CalibrationConfig.model_validate({"width": WIDTH | width, "lip": lip, "limit_mm": limit_mm})


def seen(
    place_mm: tuple[float, float, float], height_mm: float, down_deg: float, view_deg: float
) -> list[float]:
    """Where a camera at (0, 0, height) that looks along y and down sees a place; relative, by trigonometry."""
    a = radians(down_deg)
    x, y, z = place_mm[0], place_mm[1], place_mm[2] - height_mm
    ahead, below = y * np.cos(a) - z * np.sin(a), -y * np.sin(a) - z * np.cos(a)
    focal = SIZE[0] / 2 / tan(radians(view_deg) / 2)
    return [0.5 + focal * x / ahead / SIZE[0], 0.5 + focal * below / ahead / SIZE[1]]


def test_the_figures_of_a_camera_that_is_known() -> None:
    """4 m above the belt, 40 degrees down, 60 degrees wide; belt of 2 m seen from 8 m to 4 m, the lip at 3.5 m."""

    def at(x: float, y: float) -> list[float]:
        return seen((x, y, 0.0), 4000.0, 40.0, 60.0)

    config = CalibrationConfig.model_validate(
        {
            "width": {
                "far": [at(-1000, 8000), at(1000, 8000)], "near": [at(-1000, 4000), at(1000, 4000)],
                "width_mm": 2000, "view_deg": 60,
            },
            "lip": [at(-1000, 3500), at(1000, 3500)],
            "limit_mm": 500,
        }
    )  # fmt: skip
    plane = make_plane(config, *SIZE)
    view = seen_belt(config, plane, *pixels_of(config, *SIZE))
    assert view.camera_height_m == pytest.approx(4.0, rel=1e-3)
    assert view.length_m == pytest.approx(4.5, rel=1e-3)
    assert view.view_deg == pytest.approx(60.0, abs=0.1)
    # A sphere of 0.5 m on the rays to both ends, whose middle is 3.75 m below the camera, by a focal length of 554 px
    # and, 13.4 and 8.8 degrees off the axis, a little larger.
    far_m, near_m = np.hypot(8.0, 4.0) * 3.75 / 4, np.hypot(3.5, 4.0) * 3.75 / 4
    assert view.limit_far_px == pytest.approx(554 * 0.5 / far_m / np.cos(radians(13.4)) ** 1.5, rel=0.02)
    assert view.limit_near_px == pytest.approx(554 * 0.5 / near_m / np.cos(radians(8.8)) ** 1.5, rel=0.02)
    points, _ = pixels_of(config, *SIZE)
    assert to_picture(plane, on_belt(plane, points)) == pytest.approx(points, abs=1e-6)
    assert "4.0 m above the belt, of which 4.5 m are seen" in str(view)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"far": WIDTH["near"], "near": WIDTH["far"]}, "far and near are swapped"),
        ({"lip": [[0.15, 0.05], [0.85, 0.05]]}, "side of the far edge"),
        ({"lip": [[0.15, 0.35], [0.85, 0.35]]}, "runs between the points"),
        ({"lip": [[0.1, 0.0], [0.9, 0.0]], "far": [[0.45, 0.2], [0.55, 0.2]]}, "horizon"),
        ({"width_mm": 240_000}, "above the belt"),
    ],
)
def test_a_belt_that_cannot_be_is_refused_with_what_is_wrong(changed: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        make_plane(calibration(**changed), *SIZE)


def test_left_and_right_that_are_swapped_are_refused_by_the_configuration() -> None:
    with pytest.raises(ValueError, match="left and right are swapped"):
        calibration(far=list(reversed(WIDTH["far"])))


def test_a_very_wide_view_and_small_lumps_are_warned_of() -> None:
    wide = calibration(view_deg=120)
    told = seen_belt(wide, make_plane(wide, *SIZE), *pixels_of(wide, *SIZE)).warnings
    assert [one for one in told if "bends straight lines" in one]
    small = calibration(limit_mm=100)
    assert "px wide" in seen_belt(small, make_plane(small, *SIZE), *pixels_of(small, *SIZE)).warnings[0]
    usual = calibration()
    assert seen_belt(usual, make_plane(usual, *SIZE), *pixels_of(usual, *SIZE)).warnings == []


def test_points_that_contradict_each_other_are_told_and_then_refused() -> None:
    """As through a fisheye: the middle of the belt bulges to one side."""

    def of(bulge: float, **more: Any) -> CalibrationConfig:
        rows = [seen((x, y, 0.0), 4000.0, 40.0, 60.0) for y in (8000, 5500, 4000) for x in (-1000, 1000)]
        for middle in rows[2:4]:
            middle[0] += bulge / SIZE[0]
        places = [[x, y] for y in (8000, 5500, 4000) for x in (-1000, 1000)]
        return CalibrationConfig.model_validate({"points": rows, "points_mm": places, "lip": LIP} | more)

    def told(config: CalibrationConfig) -> BeltView:
        return seen_belt(config, make_plane(config, *SIZE), *pixels_of(config, *SIZE))

    good = told(of(0.0))
    assert good.warnings == []
    assert "fits within 0.0 px" in str(good)
    doubtful = told(of(12.0))
    assert 4.0 < doubtful.missed_px <= 8.0
    (warning,) = doubtful.warnings
    assert f"missed by {doubtful.missed_px:.1f} px, but error_px says 2" in warning
    assert "calibration.lens" in warning
    assert told(of(12.0, error_px=10.0)).warnings == []
    with pytest.raises(ValueError, match=r"misses the points by .* more than 4 times error_px \(2\)"):
        make_plane(of(40.0), *SIZE)


def test_the_grid_is_drawn_on_the_belt_alone() -> None:
    canvas: NDArray[np.uint8] = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    config = calibration()
    draw_belt(canvas, config, make_plane(config, *SIZE), *pixels_of(config, *SIZE))
    rows = np.flatnonzero(canvas.any(axis=(1, 2)))
    assert rows.min() > 0.1 * SIZE[1]  # nothing above the far edge but what is written there
    assert rows.max() < 0.85 * SIZE[1]
    assert canvas[369, 320].tolist() == [255, 255, 255]  # the lip
