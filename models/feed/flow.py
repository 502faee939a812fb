"""How far what a region shows has moved between two of its working pictures.

Phase correlation (Kuglin and Hines 1975) of tiles: the product of one tile's spectrum with the other's conjugate,
each frequency brought to the same magnitude, goes back to a surface with a peak at the displacement. Light that
changes slowly and dust stay in the lowest frequencies, noise in the highest; both are weighed down. A tile is small
enough for one displacement to hold for all of it on a belt that is seen at an angle.

What stands before the belt (dirt on the lens, the grid of a filmed monitor, a wall) gives a peak at zero beside the one
of what moves, so both are told: a belt that runs behind a grid runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from lumpwatch.models.roi import Image

Array = NDArray[np.float32]
Spectra = NDArray[np.complex64]

TILE = 32
"""Side of a tile, reduced pixels."""
LARGEST = 160
"""The longer side of the reduced picture is at most this, working pixels by a whole number."""
MOST_TILES = 12
_COVERED = 0.6
"""Share of a tile that must lie inside the polygon."""
_NEAR = 3
"""Displacements up to this, reduced pixels, cannot be told from the flank of a peak at zero."""
_SHIFT = TILE // 2 - 2
"""Larger displacements than this leave too little of a tile in both pictures."""
_LOW, _HIGH = 0.04, 0.22
"""Cycles a pixel that the band of frequencies rises and falls at."""


@dataclass(frozen=True, slots=True)
class Displacement:
    """How far each of n tiles has moved, reduced pixels."""

    shift: Array
    """Along x and y, of the highest peak (n, 2)."""
    peak: Array
    """Height of that peak (n,); 1 for a picture that has moved as a whole."""
    away: Array
    """Along x and y, of the highest peak that is not near zero (n, 2)."""
    away_peak: Array
    """Its height (n,)."""
    around_zero: Array
    """Each tile's surface around zero (n, 3, 3): what stands in all tiles adds up, noise does not."""


class TileFlow:
    """Displacements in one region; `mask` (h, w) is 1 inside its polygon in the working picture."""

    def __init__(self, mask: Image) -> None:
        """Raises ValueError for a region that is too small for a tile."""
        height, width = mask.shape
        self.reduction = max(1, -(-max(height, width) // LARGEST))
        """Working pixels in one reduced pixel, along each axis."""
        self._size = max(width // self.reduction, 1), max(height // self.reduction, 1)
        self._corners = _tiles(self.reduced(mask * np.uint8(255)).astype(np.float32) / 255.0)
        if not len(self._corners):
            raise ValueError(
                f"a region of {width} x {height} working pixels is too small to see its feed move"
            )
        hanning = np.hanning(TILE + 2)[1:-1]
        self._window = np.outer(hanning, hanning).astype(np.float32)
        frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None])
        band = np.exp(-0.5 * (frequency / _HIGH) ** 2) * (1.0 - np.exp(-0.5 * (frequency / _LOW) ** 2))
        # A frequency of the half spectrum stands for two, but on its first and last column.
        twice = np.where(np.isin(np.arange(TILE // 2 + 1), (0, TILE // 2)), 1.0, 2.0)
        self._band = (band * TILE * TILE / (band * twice).sum()).astype(np.float32)

    @property
    def centres(self) -> NDArray[np.float64]:
        """Middle of each tile in working pixels (n, 2)."""
        return (self._corners[:, ::-1] + TILE / 2.0) * self.reduction

    def reduced(self, picture: Image) -> Image:
        """A working picture (h, w), reduced."""
        if self.reduction == 1:
            return np.ascontiguousarray(picture)
        width, height = self._size
        inside = picture[: height * self.reduction, : width * self.reduction]
        return np.asarray(cv2.resize(inside, self._size, interpolation=cv2.INTER_AREA), np.uint8)

    def spectra(self, reduced: Image) -> Spectra:
        """Of each tile of a reduced picture, brought to magnitude 1 (n, TILE, TILE / 2 + 1)."""
        tiles = np.stack([reduced[y : y + TILE, x : x + TILE] for y, x in self._corners]).astype(np.float32)
        tiles -= tiles.mean(axis=(1, 2), keepdims=True)
        spectra = fft.rfft2(tiles * self._window)
        spectra /= np.maximum(np.abs(spectra), np.float32(1e-3))
        return np.asarray(spectra, np.complex64)

    def between(self, earlier: Spectra, later: Spectra) -> Displacement:
        """From one picture to another one."""
        surface = fft.irfft2(later * earlier.conj() * self._band, s=(TILE, TILE))
        surface = np.fft.fftshift(surface, axes=(1, 2)).astype(np.float32, copy=False)
        middle = TILE // 2
        shift, peak = _peak(surface)
        around = surface[:, middle - 1 : middle + 2, middle - 1 : middle + 2].copy()
        surface[:, middle - _NEAR : middle + _NEAR + 1, middle - _NEAR : middle + _NEAR + 1] = -1.0
        away, away_peak = _peak(surface)
        return Displacement(shift, peak, away, away_peak, around)


def _tiles(mask: Array) -> NDArray[np.intp]:
    """Upper left corners (n, 2) by row and column, spread over the region."""
    height, width = mask.shape
    if min(height, width) < TILE:
        return np.zeros((0, 2), np.intp)
    sums = cv2.integral(mask)
    for step in (TILE // 4, TILE // 2, 3 * TILE // 4, TILE):
        rows, columns = _along(height, step), _along(width, step)
        y, x = (axis.ravel() for axis in np.meshgrid(rows, columns, indexing="ij"))
        inside = sums[y + TILE, x + TILE] - sums[y, x + TILE] - sums[y + TILE, x] + sums[y, x]
        corners = np.stack([y, x], axis=1)[inside >= _COVERED * TILE * TILE]
        if len(corners) <= MOST_TILES:
            break
    if len(corners) > MOST_TILES:
        corners = corners[np.linspace(0, len(corners) - 1, MOST_TILES).round().astype(int)]
    return corners


def _along(length: int, step: int) -> NDArray[np.intp]:
    count = (length - TILE) // step + 1
    return np.linspace(0, length - TILE, count).round().astype(np.intp)


def _peak(surface: Array) -> tuple[Array, Array]:
    """Where (n, 2) from the middle, and how high (n,), the highest point of each surface is."""
    middle = TILE // 2
    low = middle - _SHIFT
    part = surface[:, low : TILE - low + 1, low : TILE - low + 1]
    n, side = len(part), part.shape[1]
    place = part.reshape(n, -1).argmax(axis=1)
    every = np.arange(n)
    y, x = low + place // side, low + place % side
    height = surface[every, y, x]
    dx = _vertex(surface[every, y, x - 1], height, surface[every, y, x + 1])
    dy = _vertex(surface[every, y - 1, x], height, surface[every, y + 1, x])
    return np.stack([x - middle + dx, y - middle + dy], axis=1).astype(np.float32), height


def _vertex(before: Array, at: Array, after: Array) -> Array:
    """Where between -0.5 and 0.5 the parabola through three neighbours is highest (n,)."""
    curve = before - 2.0 * at + after
    safe = np.where(curve < 0, curve, -1.0)
    return np.clip(np.where(curve < 0, 0.5 * (before - after) / safe, 0.0), -0.5, 0.5).astype(np.float32)
