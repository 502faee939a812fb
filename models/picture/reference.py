"""What one camera shows when its picture is fit, by day or by night."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.picture.region import RegionReference
from lumpwatch.models.roi import Image, halved

THUMB_WIDTH = 160
"""Width of the small picture by which a camera is registered."""


@dataclass(frozen=True, slots=True)
class Light:
    """One camera in one light."""

    name: str
    """`day` or `night`."""
    still: Image
    """The usual small picture: the median over the footage, so without what moved."""
    regions: Mapping[str, RegionReference]
    """Each ROI by its id."""


def thumbnail(luma: Image) -> Image:
    """The whole picture, small: (h, w) of width `THUMB_WIDTH`, or as it is where it is smaller."""
    height, width = luma.shape
    if width <= THUMB_WIDTH:
        return np.ascontiguousarray(luma)
    step = 1 << int(np.log2(width / THUMB_WIDTH))
    size = THUMB_WIDTH, max(round(height * THUMB_WIDTH / width), 1)
    return np.asarray(cv2.resize(halved(luma, step), size, interpolation=cv2.INTER_AREA), np.uint8)


def moving_mask(polygons: list[NDArray[np.float64]], shape: tuple[int, int]) -> Image:
    """(h, w), 1 inside the polygons, whose corners (k, 2) are relative to the picture."""
    mask = np.zeros(shape, np.uint8)
    for corners in polygons:
        points = np.round(corners * (shape[1], shape[0]) - 0.5).astype(np.int32)
        cv2.fillPoly(mask, [points], 1)
    return mask
