"""The plane of a calibrated belt in pictures of one size, and what no belt can be."""

from __future__ import annotations

from collections.abc import Iterable
from math import pi, tan

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.lens import Lens
from lumpwatch.models.plane import BeltPlane, fit_plane, measure, on_belt, rectangle_of_width
from lumpwatch.service.config import CalibrationConfig, RoiConfig

Array = NDArray[np.float64]

HEIGHT_M = (0.2, 100.0)
LENGTH_M = (0.2, 200.0)
"""Camera heights and belt lengths that are possible."""
_BEYOND = 0.6
"""How far beyond the lip measured points may lie, in units of the belt before it: a mark on the structure, say."""


def make_plane(config: CalibrationConfig, width: int, height: int) -> BeltPlane:
    """The belt's plane in pictures of that size. Raises ValueError, also for a belt that cannot be."""
    points, lip = pixels_of(config, width, height)
    lens = None if config.lens is None else Lens(config.lens.k1, config.lens.k2, (width, height))
    if config.width is None:
        places = np.array(config.points_mm)
    else:
        focal = width / 2 / tan(config.width.view_deg * pi / 360)
        straight = points if lens is None else lens.ideal(points)
        places = rectangle_of_width(straight, config.width.width_mm, focal, (width, height))
    plane = fit_plane(points, places, config.error_px, (width, height), lip, lens)
    check_geometry(config, plane, points, lip)
    return plane


def ride_s(roi: RoiConfig, width: int, height: int) -> float | None:
    """How long a lump takes from the region's farthest corner to the lip, in pictures of that size; None: not known.

    Raises ValueError.
    """
    config = roi.calibration
    if config is None or config.speed_m_s is None:
        return None
    plane, still, side = make_plane(config, width, height), np.zeros(2), width / 100
    places = (
        measure(plane, np.array([x * width, y * height, side, side]), still, np.ones(6))
        for x, y in roi.polygon
    )
    farthest_m = max((found.distance_m.value for found in places if found is not None), default=0.0)
    return farthest_m / config.speed_m_s if farthest_m > 0.0 else None


def check_geometry(config: CalibrationConfig, plane: BeltPlane, points: Array, lip: Array) -> None:
    """Raises ValueError with what is wrong for a belt that cannot be; `points` (n, 2) and `lip` (2, 2) in px."""
    if config.width is not None:
        far, near = (float(np.hypot(*(points[k] - points[k + 1]))) for k in (0, 2))
        if far > 1.05 * near:
            raise ValueError(
                f"calibration: the far edge ({far:.0f} px) is longer than the near one ({near:.0f} px): "
                "far and near are swapped"
            )
    height_m = float(plane.cameras.centre[0, 2]) / 1000
    if not HEIGHT_M[0] <= height_m <= HEIGHT_M[1]:
        raise ValueError(
            f"calibration: the camera would be {height_m:.3g} m above the belt; check the measures"
        )
    if not np.isfinite(on_belt(plane, lip)).all():
        raise ValueError(
            "calibration: the lip lies above the horizon of the belt, where the camera sees no belt"
        )
    away = to_lip_m(plane, points)
    length_m = float(away.max())
    if not LENGTH_M[0] <= length_m <= LENGTH_M[1]:
        raise ValueError(
            f"calibration: the belt would be {length_m:.3g} m long from its farthest point to the lip; "
            "check the order of the points, and the lip"
        )
    if away.min() < -_BEYOND * length_m:
        raise ValueError(
            "calibration: the lip runs between the points of the belt; it must lie where the belt ends"
        )
    if config.width is not None and away[:2].mean() < away[2:].mean():
        raise ValueError(
            "calibration: the lip lies on the side of the far edge; for a belt that runs away from the camera "
            "give points"
        )


def pixels_of(config: CalibrationConfig, width: int, height: int) -> tuple[Array, Array]:
    """In px: points of the calibration (n, 2), of a width far left, far right, near right, near left; lip (2, 2)."""
    size = np.array([width, height], float)
    known = config.width
    corners: Iterable[tuple[float, float]] = (
        config.points if known is None else (*known.far, *reversed(known.near))
    )
    return np.array(list(corners)) * size, np.array(config.lip) * size


def to_lip_m(plane: BeltPlane, points: Array) -> Array:
    """Metres from points in the picture (n, 2) to the lip (n,); infinite where no belt is seen."""
    away = np.einsum("nc,c->n", plane.lip[0][0] - on_belt(plane, points), plane.lip[1][0]) / 1000
    return np.where(np.isfinite(away), away, np.inf)
