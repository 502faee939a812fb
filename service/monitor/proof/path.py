"""The way of the synthetic lump: as large and as fast as lumps are, row by row, down the middle of the ROI."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning.learned import HistogramFit, Learned
from lumpwatch.models.plane import BeltPlane, measure
from lumpwatch.models.roi import Roi
from lumpwatch.service.core import LumpCut
from lumpwatch.service.protocol import LumpAt

STEP_S = 0.1
LONGEST_S = 120.0
_LEAST_SPEED_H_S = 0.02
"""A slower profile knows no belt speed."""
_ASSUMED_SPEED_H_S = 0.25
_GREYS = 17

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Way:
    """Where the lump is when, and when it arrives."""

    path: tuple[LumpAt, ...]
    arrives_s: float
    """When its leading side reaches the lip, or without one the end of the ROI; since the first frame."""


def make_way(
    roi: Roi,
    profile: RowProfile,
    size: tuple[int, int],
    begins_s: float,
    sides_px: Callable[[float, float], tuple[float, float] | None] = lambda x, y: None,
    beyond: Callable[[Array], bool] | None = None,
    size_of: tuple[float, float] = (1.0, 1.0),
) -> Way:
    """The way in a picture of `size` (w, h), from above the ROI until it has left below.

    `profile` is in working pixels. `sides_px` gives width and height of the lump at a place of the picture
    where a calibration knows them; `beyond` says whether a box (x, y, w, h by its centre, px) has reached the lip.
    `size_of` is the lump's width and height over those of the profile.
    """
    height = float(roi.shape[0])
    y, t = -0.5 * size_of[1] * _dimensions(profile, 0.0)[1], begins_s
    path: list[LumpAt] = []
    arrives_s: float | None = None
    while t - begins_s < LONGEST_S:
        working = np.array([[_middle(roi, y), y, *_dimensions(profile, y)]])
        x0, y0, w, h = roi.to_frame(working)[0]
        centre = np.array([x0 + w / 2, y0 + h / 2])
        w, h = sides_px(*centre) or (w * size_of[0], h * size_of[1])
        reached = beyond is not None and beyond(np.array([*centre, w, h]))
        if arrives_s is None and (reached or y + 0.5 * h * roi.scale >= height):
            arrives_s = t
        side = np.clip([w / size[0], h / size[1]], 1e-4, 1.0)
        place = np.clip(centre / size, -1.0, 2.0)
        path.append(LumpAt(t_s=round(t, 3), x=place[0], y=place[1], w=side[0], h=side[1]))
        if y - 0.5 * h * roi.scale > height:
            break
        y, t = y + STEP_S * _speed(profile, y, height), t + STEP_S
    return Way(tuple(path), t if arrives_s is None else arrives_s)


def reached_lip(plane: BeltPlane, box: Array) -> bool:
    """Whether a box (x, y, w, h by its centre, px) has reached the lip."""
    found = measure(plane, box, np.zeros(2), np.ones(6))
    return found is not None and found.distance_m.value <= 0.0


def over_profile(cut: LumpCut, profile: RowProfile, height: float) -> tuple[float, float]:
    """Width and height of a lump over what the profile has at its row; `height` is that of the region, working px."""
    _, y, w, h = (height * value for value in cut.box)
    usual_w, usual_h = _dimensions(profile, y)
    return w / usual_w, h / usual_h


def greys_of(learned: Learned | None) -> tuple[float, ...] | None:
    """Quantiles of the lump's brightness where the prior knows its histogram of luma."""
    fit = None if learned is None else learned.likelihood
    if not isinstance(fit, HistogramFit) or fit.channel != "luma":
        return None
    share = np.concatenate([[0.0], np.cumsum(fit.reference) / fit.reference.sum()])
    levels = np.linspace(0.0, 255.0, len(share))
    # In the middle of each step: the extremes of a histogram are seldom those of the object.
    middles = (np.arange(_GREYS) + 0.5) / _GREYS
    return tuple(float(level) for level in np.interp(middles, share, levels))


def _dimensions(profile: RowProfile, y: float) -> tuple[float, float]:
    mean, _ = profile.at(np.array([y]))
    return float(np.exp(mean[0, 2])), float(np.exp(mean[0, 3]))


def _speed(profile: RowProfile, y: float, height: float) -> float:
    mean, _ = profile.at(np.array([y]))
    speed = float(mean[0, 1])
    return speed if speed > _LEAST_SPEED_H_S * height else _ASSUMED_SPEED_H_S * height


def _middle(roi: Roi, y: float) -> float:
    """Middle of the polygon's row."""
    rows = np.flatnonzero(roi.mask.any(axis=1))
    row = int(np.clip(y, rows[0], rows[-1]))
    row = int(rows[np.abs(rows - row).argmin()])
    return float(np.flatnonzero(roi.mask[row]).mean() + 0.5)
