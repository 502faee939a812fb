"""A region of interest: its cut, its working scale and its polygon mask.

The bounding box of the polygon is cut from the picture and scaled once to the working size. All
filter lengths are pixels of that working picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class View:
    """What a likelihood sees of one frame."""

    gray: Image
    """Luma of the working picture (h, w)."""
    colour: Image | None
    """BGR of the working picture (h, w, 3), where a ROI asks for it."""
    inside: NDArray[np.int32]
    """Integral image (h + 1, w + 1) of the polygon mask."""


@dataclass(frozen=True, slots=True)
class Roi:
    """Geometry of one region in pictures of one size."""

    corners: NDArray[np.float64]
    """Polygon in full-frame pixels (k, 2)."""
    x: int
    y: int
    width: int
    height: int
    """Bounding box in full-frame pixels."""
    scale: float
    """Working pixels per full-frame pixel, at most 1."""
    mask: Image
    """Polygon in the working picture, 1 inside and 0 outside (h, w)."""
    inside: NDArray[np.int32]
    """Integral image of `mask`."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the working picture."""
        return self.mask.shape[0], self.mask.shape[1]

    def cut(self, picture: Image, offset: tuple[int, int] = (0, 0)) -> Image:
        """Cut and scale a picture plane (h, w) or (h, w, 3) whose first pixel lies at `offset`.

        Raises ValueError where the picture does not cover the region.
        """
        x, y = self.x - offset[0], self.y - offset[1]
        if x < 0 or y < 0 or x + self.width > picture.shape[1] or y + self.height > picture.shape[0]:
            raise ValueError("the picture does not cover the region of interest")
        part = picture[y : y + self.height, x : x + self.width]
        h, w = self.shape
        if (h, w) == part.shape[:2]:
            return np.ascontiguousarray(part)
        return np.asarray(cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def view(self, gray: Image, colour: Image | None = None) -> View:
        """A working picture ready for a likelihood."""
        return View(gray, colour, self.inside)

    def to_working(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Frame boxes (n, 4) by their top left corner -> working boxes by their centre; both x, y, w, h."""
        centre = boxes[:, :2] + boxes[:, 2:] / 2 - (self.x, self.y)
        return np.hstack([centre, boxes[:, 2:]]) * self.scale

    def to_frame(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """The inverse of `to_working`."""
        full = boxes / self.scale
        return np.hstack([full[:, :2] - full[:, 2:] / 2 + (self.x, self.y), full[:, 2:]])


def make_roi(polygon: Sequence[tuple[float, float]], width: int, height: int, working_size: int) -> Roi:
    """Geometry of a polygon in relative coordinates for pictures of `width` by `height` pixels.

    The longer side of the bounding box is scaled down to `working_size` pixels, never up. Raises
    ValueError where fewer than 8 by 8 working pixels would be left.
    """
    corners = np.asarray(polygon, dtype=float) * (width, height)
    low = np.clip(np.floor(corners.min(axis=0)), 0, (width, height)).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)), 0, (width, height)).astype(int)
    w, h = (int(side) for side in high - low)
    scale = min(1.0, working_size / max(w, h, 1))
    shape = round(h * scale), round(w * scale)
    if min(shape) < 8:
        raise ValueError(f"the region is only {w} x {h} pixels in a picture of {width} x {height}")
    mask = np.zeros(shape, np.uint8)
    # cv2 puts pixel centres at integers: half a pixel less than corner coordinates; 4 bits of fraction.
    points = np.round(((corners - low) * scale - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(mask, [points], 1, shift=4)
    inside = np.asarray(cv2.integral(mask), dtype=np.int32)
    return Roi(corners, int(low[0]), int(low[1]), w, h, scale, mask, inside)
