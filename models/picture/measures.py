"""Measures of one grey working picture of a region.

Fine and coarse structure are two bands of a Laplacian pyramid (Burt and Adelson 1983) over the halved
picture. Noise puts the same fine energy everywhere, so what the flattest tenth of the tiles has is taken
for noise and taken off before the bands are compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.picture.tiles import grid, tile_means
from lumpwatch.models.roi import Image

SATURATED = 235
"""Grey level from which a pixel counts as saturated: white in limited range."""
_LEAST_INSIDE = 0.5  # a tile counts where so much of it lies inside the polygon
_FLATTEST = 0.1  # share of the tiles that show the noise
_COARSE = 17  # side of the box that ends the coarse band, pixels of the halved picture


@dataclass(frozen=True, slots=True)
class PictureMeasures:
    """What one picture of a region looks like; levels are grey levels 0 to 255."""

    mean: float
    dark: float
    """5th percentile of the levels."""
    bright: float
    """95th percentile of the levels."""
    saturated: float
    """Share of saturated pixels."""
    sharpness: float
    """Deviation of the fine band over that of the coarse band, noise taken off; 0 without structure."""
    level: NDArray[np.float32]
    """Mean of each tile inside the polygon (n,)."""
    texture: NDArray[np.float32]
    """Deviation of the coarse band in each of these tiles (n,)."""
    detail: NDArray[np.float32]
    """Deviation of the fine band, noise included (n,)."""

    @property
    def contrast(self) -> float:
        """From the 5th to the 95th percentile over the mean: exposure does not change it."""
        return (self.bright - self.dark) / max(self.mean, 1.0)

    @property
    def structure(self) -> float:
        """Median deviation of the tiles over the mean: a veil or a cover over most of them takes it away."""
        return float(np.median(self.texture)) / max(self.mean, 1.0)


class PictureMeter:
    """Measures pictures of one region; `mask` (h, w) is 1 inside its polygon."""

    def __init__(self, mask: Image) -> None:
        self._rows, self._columns = grid(mask.shape)
        self._mask = np.ascontiguousarray(mask)
        self._levels = np.arange(256)
        share = tile_means(mask.astype(np.float32), self._rows, self._columns)
        self._inside = share >= min(_LEAST_INSIDE, float(share.max()))

    @property
    def tiles(self) -> int:
        """How many tiles count."""
        return int(self._inside.sum())

    def measure(self, gray: Image) -> PictureMeasures:
        """Measure one working picture (h, w)."""
        counts = cv2.calcHist([gray], [0], self._mask, [256], [0, 256]).ravel()
        total = float(counts.sum())
        below = np.cumsum(counts) / total
        size = gray.shape[1] // 2, gray.shape[0] // 2
        half = cv2.resize(gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        middle = cv2.GaussianBlur(half, (5, 5), 1.0)
        fine = self._energy(half - middle)
        coarse = self._energy(middle - cv2.blur(middle, (_COARSE, _COARSE)))
        return PictureMeasures(
            mean=float(counts @ self._levels) / total,
            dark=float(np.searchsorted(below, 0.05)),
            bright=float(np.searchsorted(below, 0.95)),
            saturated=float(counts[SATURATED:].sum()) / total,
            sharpness=float(np.sqrt(_excess(fine) / (_excess(coarse) + 1.0))),
            level=tile_means(half, self._rows, self._columns)[self._inside],
            texture=np.sqrt(coarse),
            detail=np.sqrt(fine),
        )

    def _energy(self, band: NDArray[np.float32]) -> NDArray[np.float32]:
        """Mean square of each tile that counts (n,)."""
        return tile_means(np.square(band), self._rows, self._columns)[self._inside]


def _excess(energy: NDArray[np.float32]) -> float:
    """Mean over the tiles beyond what the flattest of them have."""
    k = int(_FLATTEST * len(energy))
    return max(float(energy.mean() - np.partition(energy, k)[k]), 0.0)
