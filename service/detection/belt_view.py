"""What a calibration means, to be looked at: how long the belt is, how high the camera hangs, how large a lump appears.

`BeltView` has the figures, and `draw` the grid on a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.plane import BeltPlane, on_belt, side_of, to_picture
from lumpwatch.models.roi import Image
from lumpwatch.service.belt import to_lip_m
from lumpwatch.service.config import CalibrationConfig
from lumpwatch.service.core import draw_lip, write_words

Array = NDArray[np.float64]

WIDE_DEG = 100.0
"""Lenses that see more than this bend straight lines."""
_STEPS_M = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
_DOUBTFUL = 2.0
"""Times the stated error of the points from which that is said; from `models.plane.TOLERANCE` on they are refused."""
_GRID, _INK = (90, 220, 255), (255, 255, 255)


@dataclass(frozen=True, slots=True)
class BeltView:
    """What a calibrated camera sees of its belt."""

    camera_height_m: float
    length_m: float
    """From the farthest point of the calibration to the lip."""
    view_deg: float
    missed_px: float
    error_px: float
    """To how much the points are known, as stated."""
    lens: bool
    """Whether the lens' distortion is taken out."""
    limit_far_px: float | None
    limit_near_px: float | None
    """Side of the box of a lump of the limit's size, where the belt is farthest and at the lip."""

    @property
    def warnings(self) -> list[str]:
        """What is possible, and yet deserves a second look."""
        found = []
        if self.missed_px > _DOUBTFUL * self.error_px:
            bent = "" if self.lens else ", or give calibration.lens where straight edges look bent"
            found.append(
                f"the points are missed by {self.missed_px:.1f} px, but error_px says {self.error_px:g}: sizes and "
                f"speeds are wrong by more than is told; measure the points again{bent}"
            )
        if self.view_deg > WIDE_DEG and not self.lens:
            found.append(
                f"the camera sees {self.view_deg:.0f} degrees across: so wide a lens bends straight lines; give "
                "calibration.lens (lumpwatch lens finds it), and check view_deg against the data sheet (horizontal, "
                "not diagonal)"
            )
        if self.limit_far_px is not None and self.limit_far_px < 20:
            found.append(
                f"a lump of the limit's size is only {self.limit_far_px:.0f} px wide where the belt is farthest: "
                "lumps need some 40 px where they first appear"
            )
        return found

    def __str__(self) -> str:
        """One line for a person."""
        limit = ""
        if self.limit_far_px is not None and self.limit_near_px is not None:
            limit = (
                f"; a lump of the limit's size is {self.limit_far_px:.0f} px wide far away and "
                f"{self.limit_near_px:.0f} px at the lip"
            )
        return (
            f"calibration fits within {self.missed_px:.1f} px; the camera sees {self.view_deg:.0f} degrees across and "
            f"is {self.camera_height_m:.1f} m above the belt, of which {self.length_m:.1f} m are seen up to the "
            f"lip{limit}"
        )


def seen_belt(config: CalibrationConfig, plane: BeltPlane, points: Array, lip: Array) -> BeltView:
    """The figures; `points` (n, 2) of the calibration and `lip` (2, 2) in pixels of the picture."""
    away = to_lip_m(plane, points)
    far = points[np.isclose(away, away.max(), rtol=0.05)].mean(axis=0)
    sides: tuple[float | None, float | None] = (None, None)
    if config.limit_mm is not None:
        found = side_of(plane, np.stack([far, lip.mean(axis=0)]), config.limit_mm)
        sides = (float(found[0]), float(found[1]))
    return BeltView(
        float(plane.cameras.centre[0, 2]) / 1000,
        float(away.max()),
        plane.view_deg,
        plane.missed_px,
        config.error_px,
        config.lens is not None,
        *sides,
    )


def draw_belt(canvas: Image, config: CalibrationConfig, plane: BeltPlane, points: Array, lip: Array) -> None:
    """Draw the belt's grid into a BGR picture: metres to the lip, the lip, and lumps of the limit's size."""
    away = to_lip_m(plane, points)
    start, beyond = plane.lip[0][0], plane.lip[1][0]
    along = np.array([-beyond[1], beyond[0]])
    across = (on_belt(plane, points) - start) @ along
    low, high, length_m = float(across.min()), float(across.max()), float(away.max())
    step_m = next((step for step in _STEPS_M if length_m / step <= 10), _STEPS_M[-1])
    for metres in np.arange(0.0, length_m + 1e-9, step_m):
        at = start - 1000 * metres * beyond
        ends = to_picture(plane, np.array([at + low * along, at + high * along]))
        _line(canvas, ends)
        write_words(canvas, f"{metres:g} m", _pixel(ends[1]), _GRID)
    for side in (low, (low + high) / 2, high):
        at = start + side * along
        _line(canvas, to_picture(plane, np.array([at, at - 1000 * length_m * beyond])))
    draw_lip(canvas, (_pixel(lip[0]), _pixel(lip[1])))
    if config.limit_mm is not None:
        for metres in (0.15 * length_m, 0.95 * length_m):
            middle = to_picture(plane, (start - 1000 * metres * beyond + (low + high) / 2 * along)[None])
            side = float(side_of(plane, middle, config.limit_mm)[0])
            if np.isfinite(side):
                cv2.circle(canvas, _pixel(middle[0]), max(round(side / 2), 1), _INK, 2, cv2.LINE_AA)
                write_words(canvas, f"{config.limit_mm:g} mm: {side:.0f} px", _pixel(middle[0]), _INK)


def _line(canvas: Image, ends: Array) -> None:
    if np.isfinite(ends).all() and hypot(*ends[0]) < 1e5 and hypot(*ends[1]) < 1e5:
        cv2.line(canvas, _pixel(ends[0]), _pixel(ends[1]), _GRID, 1, cv2.LINE_AA)


def _pixel(point: Array) -> tuple[int, int]:
    x, y = np.clip(np.nan_to_num(point), -1e5, 1e5)
    return round(float(x)), round(float(y))
