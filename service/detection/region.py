"""From the configuration of a region to its geometry in pictures of one size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.plane import BeltPlane, side_of
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.service.belt import make_plane
from lumpwatch.service.config import CalibrationConfig, RoiConfig
from lumpwatch.service.detection.sizing import SHAPE_FACTOR


def make_region(config: RoiConfig, width: int, height: int) -> Roi:
    """The region in pictures of that size, with the limit's size by row where the belt is calibrated.

    Raises ValueError for a polygon or a calibration that makes no sense there.
    """
    roi = make_roi(config.polygon, width, height, config.working_size_px)
    calibration = config.calibration
    if calibration is None or calibration.limit_mm is None:
        return roi
    limit = _limit_px(roi, make_plane(calibration, width, height), calibration.limit_mm)
    return replace(roi, limit_px=limit, entry=_entry(roi, calibration, limit, width, height))


def _entry(
    roi: Roi, calibration: CalibrationConfig, limit_px: NDArray[np.float64], width: int, height: int
) -> Image:
    """The part of the region that is as far from the lip as a lump at the limit is large, and farther.

    On a belt that is short for such lumps it reaches nearer to the lip. What is first seen beyond that can no
    longer be announced in time, and ore that falls off the belt, in its dust, looks like large lumps of every
    shape.
    """
    size = (width, height)
    a, b = (np.array(end) * size for end in calibration.lip)
    known = calibration.points if calibration.width is None else calibration.width.far
    y, x = np.mgrid[: roi.shape[0], : roi.shape[1]] + 0.5
    place = np.stack([roi.x + x / roi.scale, roi.y + y / roi.scale], axis=-1)
    normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.hypot(*(b - a))
    side = np.sign((np.mean(np.array(known) * size, axis=0) - a) @ normal)
    left = side * ((place - a) @ normal) * roi.scale
    belt = roi.mask * (left > 0).astype(np.uint8)
    if not belt.any():
        return roi.mask  # a region that shows the fall only
    for lengths in (1.0, 0.5):
        entry = belt * (left > lengths * limit_px[:, None]).astype(np.uint8)
        if 3 * entry.sum() >= belt.sum():
            return entry
    return belt


def _limit_px(roi: Roi, plane: BeltPlane, limit_mm: float) -> NDArray[np.float64]:
    """Side of a lump at the limit in the middle of each row, working px (h,); rows without any get the nearest's."""
    rows = np.arange(roi.shape[0])
    known = np.flatnonzero(roi.mask.any(axis=1))
    middles = np.array([np.flatnonzero(roi.mask[row]).mean() + 0.5 for row in known])
    points = np.column_stack([roi.x + middles / roi.scale, roi.y + (known + 0.5) / roi.scale])
    sides = roi.scale * side_of(plane, points, limit_mm / SHAPE_FACTOR)
    seen = np.isfinite(sides)
    if not seen.any():
        raise ValueError("calibration: the region shows nothing of the belt")
    return np.interp(rows, known[seen], sides[seen])
