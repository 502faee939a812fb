"""Small windows of a picture, made comparable: neither light nor a smooth veil of dust changes them.

A window is taken from the picture without its coarse part, and scaled to mean 0 and length 1. The product of two such
windows is their correlation: 1 where they show the same, near 0 where one shows something else, or noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

STRIDE, SIDE = 8, 12
"""Windows overlap by a few pixels, so that a stone on a border is seen as a whole by one of them."""
_FINE, _COARSE = 0.8, 5.0
"""Standard deviations of the two blurs, px: noise is below the first, light and dust are above the second."""
_FAINT, _CONTRAST = 1.0, 0.02
"""A window whose deviation is below so many grey levels, or this share of its brightness, shows nothing."""
_REACH = 2
"""How far a camera that shakes may move the picture, px."""
_SHIFTS = [(y, x) for y in range(2 * _REACH + 1) for x in range(2 * _REACH + 1)]

_LEFT = 0.35
"""Share of the noise that the first blur leaves."""
_LEAST = 0.5
"""A window of which less than this share is no noise tells nothing."""
_LAPLACE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)

Windows = NDArray[np.float32]
"""(n, SIDE * SIDE)"""


@dataclass(frozen=True, slots=True)
class Look:
    """The windows of one picture."""

    shifted: NDArray[np.float32]
    """Each for every shift of the camera, of mean 0 and length 1 (shifts, n, SIDE * SIDE)."""
    plain: Windows
    """In their places, grey levels."""
    deviation: NDArray[np.float32]
    """Of each, grey levels (n,)."""
    faint: NDArray[np.float32]
    """A deviation below this shows nothing (n,)."""
    noise: float
    """Deviation of what is noise in a window, grey levels, as far as one picture tells."""

    @property
    def now(self) -> Windows:
        """In their places, of mean 0 and length 1."""
        return self.shifted[len(self.shifted) // 2]

    def certain(self, noise: float) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """Which show anything (n,), and the share of each that is no noise: so alike are two of the same thing."""
        share = 1.0 - (max(noise, self.noise) / np.maximum(self.deviation, 1e-6)) ** 2
        shows = (self.deviation >= self.faint) & (share >= _LEAST)
        return shows, np.clip(share, _LEAST, 1.0).astype(np.float32)

    def changed(self, before: Windows) -> NDArray[np.float32]:
        """Deviation of what is not as `before`, over the root of 2: where nothing moves that of the noise (n,)."""
        return np.asarray((self.plain - before).std(axis=1) / np.sqrt(2.0), np.float32)


class PatchGrid:
    """The windows of a region with a mask (h, w)."""

    def __init__(self, mask: Image) -> None:
        """Raises ValueError for a region in which no window fits."""
        height, width = mask.shape
        margin = SIDE + 2 * _REACH
        if height < margin or width < margin:
            raise ValueError(f"a mouth must be at least {margin} working pixels wide and high")
        rows = np.arange(0, height - margin + 1, STRIDE)
        columns = np.arange(0, width - margin + 1, STRIDE)
        inside = np.array(
            [[mask[y : y + margin, x : x + margin].mean() for x in columns] for y in rows], np.float32
        )
        chosen = inside >= min(0.75, float(inside.max()))
        self._rows, self._columns = np.nonzero(chosen)
        self._rows, self._columns = self._rows * STRIDE, self._columns * STRIDE
        if not inside.any():
            raise ValueError("nothing of the mouth is to be looked at")
        self.place = np.where(chosen, np.cumsum(chosen).reshape(chosen.shape) - 1, -1)
        """Index of the window at each place of the grid (rows, columns); -1: none."""

    def __len__(self) -> int:
        return len(self._rows)

    def take(self, picture: Image) -> Look:
        """What a working picture (h, w) shows."""
        gray = picture.astype(np.float32)
        fine = cv2.GaussianBlur(gray, (0, 0), _FINE)
        coarse = cv2.GaussianBlur(gray, (0, 0), _COARSE)
        views = np.lib.stride_tricks.sliding_window_view(fine - coarse, (SIDE, SIDE))
        shifted = np.stack(
            [views[self._rows + y, self._columns + x].reshape(len(self), SIDE * SIDE) for y, x in _SHIFTS]
        )
        shifted -= shifted.mean(axis=-1, keepdims=True)
        middle = len(_SHIFTS) // 2
        plain = shifted[middle].copy()
        length = np.sqrt(np.einsum("snk,snk->sn", shifted, shifted))
        shifted /= np.maximum(length, 1e-6)[..., None]
        brightness = coarse[self._rows + SIDE // 2 + _REACH, self._columns + SIDE // 2 + _REACH]
        faint = np.maximum(_FAINT, _CONTRAST * brightness)
        return Look(shifted, plain, length[middle] / SIDE, faint, _LEFT * noise_of(gray))


def likeness(shifted: NDArray[np.float32], of: Windows) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """How well any shifted window shows the same as one of `of` (n,), and which shift shows it best (n,)."""
    products = np.einsum("snk,nk->sn", shifted, of)
    best = products.argmax(axis=0)
    return products[best, np.arange(len(best))], best


def noise_of(gray: NDArray[np.float32]) -> float:
    """Standard deviation of the noise of a picture, after Immerkaer (1996), by the median: edges are outliers."""
    return float(1.4826 / 6.0 * np.median(np.abs(cv2.filter2D(gray, -1, _LAPLACE))))
