"""Integral images of a picture inside its polygon: what a box measures costs the same whatever its size.

Five sums of a pixel are kept: its brightness, the square of it, the gradient |dx| + |dy| of its neighbours,
|dx| alone, and the gradient of the picture smoothed over `COARSE` pixels, in which small ore is gone and the
shape of large bodies is left. What lies outside the polygon counts as nothing, in sums and in areas; for
gradients the picture goes on beyond the polygon's edge as it is there.

Two sums share one 64-bit word. Words wrap around and the lower sum carries into the upper one, but all of it
cancels in the difference of a box's corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.likelihood.base import box_sum
from lumpwatch.models.roi import Image, View

COARSE = 7
"""Pixels over which the coarse picture is smoothed."""
REACH = COARSE // 2 + 1
"""Pixels to either side between which the coarse gradient is taken."""
_Picture = NDArray[np.integer[Any] | np.floating[Any]]
_SHIFT = np.uint64(3)  # bits of a coarse gradient that are given up, for the sum over a box to fit
_COARSE_LEVELS = 2.0 ** int(_SHIFT) / COARSE**2
"""Grey levels in one unit of the coarse sum."""
_UPPER, _LOWER = np.uint64(32), np.uint64(0xFFFFFFFF)


@dataclass(frozen=True, slots=True)
class _Region:
    """A polygon in the working picture."""

    inside: NDArray[np.int32]
    mask: Image
    outside: NDArray[np.intp]
    """Pixels outside, in the flat picture."""
    nearest: NDArray[np.intp]
    """Those that stand for them."""


class PictureSums:
    """The integral images of one picture after another, in the same memory."""

    def __init__(self) -> None:
        self._sums = np.zeros((0, 0, 3), np.uint64)
        self._region: _Region | None = None

    def of(self, view: View) -> NDArray[np.uint64]:
        """Integral images side by side (h + 1, w + 1, 3); they hold until the next call.

        Brightness (upper half of the word) with gradient, squares, and |dx| with the coarse gradient.
        """
        height, width = view.gray.shape
        if self._sums.shape[:2] != (height + 1, width + 1):
            self._sums = np.zeros((height + 1, width + 1, 3), np.uint64)
        region = self._region
        if region is None or region.inside is not view.inside:
            region = self._region = _region(view.inside)
        filled = view.gray.copy()
        filled.ravel()[region.outside] = filled.ravel()[region.nearest]
        smooth = np.asarray(cv2.boxFilter(filled, cv2.CV_16U, (COARSE, COARSE), normalize=False))
        across, down = _gradients(filled, 1)
        _integrate(filled, across, down, *_gradients(smooth, REACH), region.mask, self._sums)
        return self._sums


def _region(inside: NDArray[np.int32]) -> _Region:
    mask = np.diff(np.diff(inside, axis=0), axis=1).astype(np.uint8)
    height, width = mask.shape
    columns = np.arange(width)
    with_any = np.flatnonzero(mask.any(axis=1))
    nearest = np.arange(height * width).reshape(height, width)
    for row in range(height):
        source = with_any[np.abs(with_any - row).argmin()] if len(with_any) else row
        known = np.flatnonzero(mask[source])
        if len(known):
            after = np.clip(np.searchsorted(known, columns), 0, len(known) - 1)
            before = np.clip(after - 1, 0, None)
            closer = np.abs(known[before] - columns) <= np.abs(known[after] - columns)
            nearest[row] = source * width + np.where(closer, known[before], known[after])
    outside = np.flatnonzero(mask.ravel() == 0)
    return _Region(inside, mask, outside, nearest.ravel()[outside])


def _gradients(picture: _Picture, reach: int) -> tuple[_Picture, _Picture]:
    """Differences of the pixels `reach` to the left and right, and above and below; the border is repeated."""
    wide = cv2.copyMakeBorder(picture, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    level, upright = wide[reach:-reach], wide[:, reach:-reach]
    across = cv2.absdiff(level[:, 2 * reach :], level[:, : -2 * reach])
    return np.asarray(across), np.asarray(cv2.absdiff(upright[2 * reach :], upright[: -2 * reach]))


@njit(cache=True)
def _integrate(gray, across, down, coarse_across, coarse_down, mask, out):  # type: ignore[no-untyped-def]
    """One pass over the picture, the sums of a pixel side by side in memory."""
    height, width = gray.shape
    for y in range(height):
        first, second, third = np.uint64(0), np.uint64(0), np.uint64(0)
        for x in range(width):
            if mask[y, x]:
                value, dx = np.uint64(gray[y, x]), np.uint64(across[y, x])
                coarse = np.uint64(coarse_across[y, x]) + np.uint64(coarse_down[y, x])
                first += (value << _UPPER) + dx + np.uint64(down[y, x])
                second += value * value
                third += (dx << _UPPER) + (coarse >> _SHIFT)
            out[y + 1, x + 1, 0] = out[y, x + 1, 0] + first
            out[y + 1, x + 1, 1] = out[y, x + 1, 1] + second
            out[y + 1, x + 1, 2] = out[y, x + 1, 2] + third


@njit(cache=True)
def _difference(sums, box, k):  # type: ignore[no-untyped-def]
    x0, y0, x1, y1 = box
    return sums[y1, x1, k] - sums[y0, x1, k] - sums[y1, x0, k] + sums[y0, x0, k]


@njit(cache=True)
def sums_of(sums, inside, box):  # type: ignore[no-untyped-def]
    """Brightness, square, gradient and area of a box."""
    both = _difference(sums, box, 0)
    area = box_sum(inside, box[0], box[1], box[2], box[3])
    return float(both >> _UPPER), float(_difference(sums, box, 1)), float(both & _LOWER), float(area)


@njit(cache=True)
def coarse_of(sums, box):  # type: ignore[no-untyped-def]
    """Sum of the coarse gradient over a box, grey levels."""
    return float(_difference(sums, box, 2) & _LOWER) * _COARSE_LEVELS


@njit(cache=True)
def brightness_of(sums, box):  # type: ignore[no-untyped-def]
    """Sum of the brightness over a box."""
    return float(_difference(sums, box, 0) >> _UPPER)


@njit(cache=True)
def unpacked(first, third):  # type: ignore[no-untyped-def]
    """Brightness, gradient, |dx| and coarse gradient of a box whose first and third word are given, as int64."""
    return (
        float((first >> 32) & 0xFFFFFFFF),
        float(first & 0xFFFFFFFF),
        float((third >> 32) & 0xFFFFFFFF),
        float(third & 0xFFFFFFFF) * _COARSE_LEVELS,
    )
