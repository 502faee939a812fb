"""A region of interest: its cut, its working scale and its polygon mask.

The bounding box of the polygon is cut from the picture and scaled once to the working size. All
filter lengths are pixels of that working picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import as_finite, check_shape

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

    def __post_init__(self) -> None:
        """Raises ValueError where the picture is not 8-bit, or not of the region's size."""
        check_shape(self.inside, ("h + 1", "w + 1"), "inside")
        height, width = self.inside.shape[0] - 1, self.inside.shape[1] - 1
        _check_picture(self.gray, (height, width), "gray")
        if self.colour is not None:
            _check_picture(self.colour, (height, width, 3), "colour")


@dataclass(frozen=True, slots=True, kw_only=True)
class Roi:
    """Geometry of one region in pictures of one size."""

    corners: NDArray[np.float64]
    """Polygon in full-frame pixels (k, 2)."""
    x: int
    y: int
    width: int
    height: int
    """Bounding box in full-frame pixels."""
    step: int
    """x, y, width and height are multiples of this power of two, by which halving alone scales down."""
    scale: float
    """Working pixels per full-frame pixel, at most 1."""
    mask: Image
    """Polygon in the working picture, 1 inside and 0 outside (h, w)."""
    inside: NDArray[np.int32]
    """Integral image of `mask`."""
    limit_px: NDArray[np.float64] | None = None
    """Side of the box of an object at the size limit by row of the working picture (h,); None: no limit known."""
    entry: Image | None = None
    """Where in `mask` an object may be found first (h, w); None: anywhere in it."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the working picture."""
        return self.mask.shape[0], self.mask.shape[1]

    def at(self, x: int, y: int) -> Roi:
        """The same region elsewhere in the picture; x and y are multiples of `step`."""
        return replace(self, x=x, y=y, corners=self.corners + np.array([x - self.x, y - self.y]))

    def cut(self, picture: Image, offset: tuple[int, int] = (0, 0), reduction: int = 1) -> Image:
        """Cut and scale a picture plane (h, w) or (h, w, 3) whose first pixel lies at `offset`.

        A pixel of the plane is the mean of `reduction` x `reduction` pixels of the frame (see
        `halved`); the result is the same for every reduction up to `step`. Raises ValueError where
        the plane does not cover the region or is reduced too far.
        """
        if self.step % reduction:
            raise ValueError(f"the region needs at most {self.step} pixels in one, not {reduction}")
        if (self.x - offset[0]) % reduction or (self.y - offset[1]) % reduction:
            raise ValueError(f"the region does not start on a block of {reduction} pixels from {offset}")
        x, y = (self.x - offset[0]) // reduction, (self.y - offset[1]) // reduction
        right, bottom = x + self.width // reduction, y + self.height // reduction
        if x < 0 or y < 0 or right > picture.shape[1] or bottom > picture.shape[0]:
            raise ValueError("the picture does not cover the region of interest")
        part = halved(picture[y:bottom, x:right], self.step // reduction)
        h, w = self.shape
        if (h, w) == part.shape[:2]:
            return np.ascontiguousarray(part)
        return np.asarray(cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def view(self, gray: Image, colour: Image | None = None) -> View:
        """A working picture ready for a likelihood: `gray` (h, w) and `colour` (h, w, 3), uint8.

        Raises ValueError for a picture of another size than the region's `shape` (`cut` makes one of a frame).
        """
        return View(gray, colour, self.inside)

    def to_working(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Frame boxes (n, 4) by their top left corner -> working boxes by their centre; both x, y, w, h."""
        centre = boxes[:, :2] + boxes[:, 2:] / 2 - (self.x, self.y)
        return np.hstack([centre, boxes[:, 2:]]) * self.scale

    def to_frame(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """The inverse of `to_working`."""
        full = boxes / self.scale
        return np.hstack([full[:, :2] - full[:, 2:] / 2 + (self.x, self.y), full[:, 2:]])


def _check_picture(picture: Image, shape: tuple[int, ...], name: str) -> None:
    """A uint8 picture of the region's size."""
    check_shape(picture, shape, f"the picture ({name})")
    if picture.dtype != np.uint8:
        raise ValueError(f"the picture ({name}) must be of uint8, 0 to 255, not of {picture.dtype}")


def halved(picture: Image, times_smaller: int) -> Image:
    """The mean of blocks of `times_smaller` (a power of two) squared pixels, by repeated halving.

    Halving an even number of pixels is the one scaling that OpenCV vectorises: five times halved is
    still ten times faster than any other area mean. An odd last row or column is left out.
    """
    while times_smaller > 1:
        h, w = picture.shape[0] // 2, picture.shape[1] // 2
        picture = np.asarray(
            cv2.resize(picture[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
        times_smaller //= 2
    return picture


def make_roi(polygon: Sequence[tuple[float, float]], width: int, height: int, working_size: int) -> Roi:
    """Geometry of a polygon in relative coordinates for pictures of `width` by `height` pixels.

    The longer side of the bounding box is scaled down to `working_size` pixels, never up. Raises
    ValueError where fewer than 8 by 8 working pixels would be left, and for a polygon that is not three corners
    or more (k, 2).
    """
    size = np.array([width, height])
    corners = as_finite(polygon, ("k", 2), "polygon") * size
    if len(corners) < 3:
        raise ValueError(f"polygon must have three corners or more, not {len(corners)}")
    low, high = corners.min(axis=0), corners.max(axis=0)
    longest = max(float((high - low).max()), 1.0)
    step = 1 << int(np.log2(max(longest / working_size, 1.0)))
    # A box on the grid of the halvings gives the same pixels wherever the halving is done.
    first = np.clip(np.floor(low / step), 0, size // step).astype(int) * step
    last = np.clip(np.ceil(high / step), 0, size // step).astype(int) * step
    w, h = (int(side) for side in last - first)
    scale = min(1.0, working_size / max(w, h, 1))
    # One scale for both axes: rounding the shorter side leaves at most half a pixel at its far end.
    shape = round(h * scale), round(w * scale)
    if min(shape) < 8:
        raise ValueError(f"the region is only {w} x {h} pixels in a picture of {width} x {height}")
    mask = np.zeros(shape, np.uint8)
    # cv2 puts pixel centres at integers: half a pixel less than corner coordinates; 4 bits of fraction.
    points = np.round(((corners - first) * scale - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(mask, [points], 1, shift=4)
    inside = np.asarray(cv2.integral(mask), dtype=np.int32)
    return Roi(
        corners=corners,
        x=int(first[0]),
        y=int(first[1]),
        width=w,
        height=h,
        step=step,
        scale=scale,
        mask=mask,
        inside=inside,
    )
