"""Small windows of a picture, made comparable: neither light nor a smooth veil of dust changes them.

A window is taken from the picture without its coarse part, and scaled to mean 0 and length 1. The product of two such
windows is their correlation: 1 where they show the same, near 0 where one shows something else, or noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

STRIDE, SIDE = 8, 12
"""Windows overlap by a few pixels, so that a stone on a border is seen as a whole by one of them."""
_FINE, _COARSE = 0.8, 5.0
"""Standard deviations of the two blurs, px: noise is below the first, light and dust are above the second."""
_FAINT, _CONTRAST = 1.0, 0.015
"""A window whose deviation is below so many grey levels, or this share of its brightness, shows nothing."""
_REACH = 2
"""How far a camera that shakes may move the picture, px."""
_SHIFTS = [(y, x) for y in range(2 * _REACH + 1) for x in range(2 * _REACH + 1)]

_LEAST_SQUARE = 1e-14
"""Squared deviation that counts as none, grey levels."""
_LEFT = 0.35
"""Share of the noise that the first blur leaves."""
_LAPLACE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)

Windows = NDArray[np.float32]
"""(n, SIDE * SIDE)"""


@dataclass(frozen=True, slots=True)
class Band:
    """One picture without its coarse part."""

    picture: NDArray[np.float32]
    """(h, w), with a border of the reach."""
    plain: Windows
    """The windows in their places, of mean 0, grey levels."""
    deviation: NDArray[np.float32]
    """Of each, grey levels (n,)."""
    faint: NDArray[np.float32]
    """A deviation below this shows nothing (n,)."""
    noise: float
    """Deviation of what is noise in a window, grey levels, as far as one picture tells."""

    def changed(self, before: Windows) -> NDArray[np.float32]:
        """Deviation of what is not as `before`, over the root of 2: where nothing moves that of the noise (n,)."""
        return np.asarray((self.plain - before).std(axis=1) / np.sqrt(2.0), np.float32)


@dataclass(frozen=True, slots=True)
class Look:
    """The windows of a picture, or of several averaged, each for every shift of the camera."""

    raw: NDArray[np.float32]
    """As they are cut (n, shifts, SIDE * SIDE)."""
    mean: NDArray[np.float32]
    """Of each (n, shifts)."""
    length: NDArray[np.float32]
    """Of each without its mean, never 0 (n, shifts)."""

    at_reach: ClassVar[NDArray[np.bool_]] = np.array(
        [max(abs(y - _REACH), abs(x - _REACH)) == _REACH for y, x in _SHIFTS]
    )
    """Which shifts are the largest (shifts,)."""

    @property
    def deviation(self) -> NDArray[np.float32]:
        """Of each in its place, grey levels (n,)."""
        return np.asarray(self.length[:, len(_SHIFTS) // 2] / SIDE, np.float32)

    @property
    def now(self) -> Windows:
        """In their places, of mean 0 and length 1."""
        return self.moved(np.arange(len(self.raw)), len(_SHIFTS) // 2)

    def moved(self, which: NDArray[np.intp], shift: NDArray[np.intp] | int) -> Windows:
        """Some (k,) of the windows, moved by their shifts (k,), of mean 0 and length 1."""
        plain = self.raw[which, shift] - self.mean[which, shift][:, None]
        return np.asarray(plain / self.length[which, shift][:, None], np.float32)

    def likeness(self, *of: Windows) -> list[tuple[NDArray[np.float32], NDArray[np.intp]]]:
        """For each of `of`, windows of mean 0 and length 1: how well any shift shows the same (n,), and which shows it
        best (n,).
        """
        # What is multiplied with a mean of 0 needs none taken off.
        products = np.matmul(self.raw, np.stack(of, axis=2)) / self.length[..., None]
        best = products.argmax(axis=1)
        likely = np.take_along_axis(products, best[:, None], axis=1)[:, 0]
        return [(likely[:, i], best[:, i]) for i in range(len(of))]


class PatchGrid:
    """The windows of a region with a mask (h, w)."""

    def __init__(self, mask: Image) -> None:
        """Raises ValueError for a region in which no window fits."""
        height, width = mask.shape
        if height < SIDE or width < SIDE:
            raise ValueError(f"a mouth must be at least {SIDE} working pixels wide and high")
        rows, columns = _spread(height), _spread(width)
        inside = np.array(
            [[mask[y : y + SIDE, x : x + SIDE].mean() for x in columns] for y in rows], np.float32
        )
        if not inside.any():
            raise ValueError("nothing of the mouth is to be looked at")
        chosen = inside >= min(0.75, float(inside.max()))
        at = np.nonzero(chosen)
        self._rows, self._columns = rows[at[0]], columns[at[1]]
        self.place = np.where(chosen, np.cumsum(chosen).reshape(chosen.shape) - 1, -1)
        """Index of the window at each place of the grid (rows, columns); -1: none."""
        self.weight = self._weights(mask)
        """Share of the region that each window stands for (n,); of sum 1."""

    def __len__(self) -> int:
        return len(self._rows)

    def band(self, picture: Image) -> Band:
        """What a working picture (h, w) shows without its coarse part."""
        gray = picture.astype(np.float32)
        coarse = cv2.GaussianBlur(gray, (0, 0), _COARSE)
        fine = cv2.GaussianBlur(gray, (0, 0), _FINE) - coarse
        padded = cv2.copyMakeBorder(fine, _REACH, _REACH, _REACH, _REACH, cv2.BORDER_REFLECT_101)
        plain = self._windows(padded, _REACH, _REACH)
        brightness = coarse[self._rows + SIDE // 2, self._columns + SIDE // 2]
        return Band(
            np.asarray(padded, np.float32),
            plain,
            plain.std(axis=1),
            np.maximum(_FAINT, _CONTRAST * brightness),
            _LEFT * noise_of(gray),
        )

    def take(self, band: NDArray[np.float32]) -> Look:
        """The windows of a band (h, w), one or the mean of several."""
        y, x = np.array(_SHIFTS).T
        rows, columns = self._rows[:, None] + y, self._columns[:, None] + x
        views = np.lib.stride_tricks.sliding_window_view(band, (SIDE, SIDE))
        raw = views[rows, columns].reshape(len(self), len(_SHIFTS), SIDE * SIDE)
        mean = _box(band)[rows, columns]
        squares = _box(band * band)[rows, columns] - mean * mean
        return Look(raw, mean, SIDE * np.sqrt(np.maximum(squares, _LEAST_SQUARE)))

    def _windows(self, band: cv2.typing.MatLike, y: int, x: int) -> Windows:
        """(n, SIDE * SIDE), of mean 0."""
        views = np.lib.stride_tricks.sliding_window_view(np.asarray(band, np.float32), (SIDE, SIDE))
        plain = views[self._rows + y, self._columns + x].reshape(len(self), SIDE * SIDE)
        return plain - plain.mean(axis=1, keepdims=True)

    def _weights(self, mask: Image) -> NDArray[np.float32]:
        """Each pixel of the region belongs to the nearest window: those at its border stand for more."""
        pixels = np.argwhere(mask > 0).astype(np.float32)
        middles = np.column_stack([self._rows, self._columns]).astype(np.float32) + (SIDE - 1) / 2
        away = ((pixels[:, None] - middles[None]) ** 2).sum(axis=2)
        counts = np.bincount(away.argmin(axis=1), minlength=len(middles))
        return (counts / counts.sum()).astype(np.float32)


def _spread(length: int) -> NDArray[np.intp]:
    """Where windows begin along an axis, from one border to the other."""
    count = -(-(length - SIDE) // STRIDE) + 1
    return np.linspace(0, length - SIDE, count).round().astype(np.intp)


def _box(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean of the window that begins at each pixel (h, w); of no use where it does not fit."""
    return np.asarray(cv2.boxFilter(picture, -1, (SIDE, SIDE), anchor=(0, 0)), np.float32)


def noise_of(gray: NDArray[np.float32]) -> float:
    """Standard deviation of the noise of a picture, after Immerkaer (1996), by the median: edges are outliers."""
    return float(1.4826 / 6.0 * np.median(np.abs(cv2.filter2D(gray, -1, _LAPLACE))))
