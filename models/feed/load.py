"""How much of a belt is covered, by its texture.

Bulk material throws shadows between its pieces: in cells of some pixels its brightness varies by a share of itself that
neither exposure nor a veil of even light changes much. Rubber and swept steel are smoother. Noise is the same at every
scale: what the finest scale shows of it is taken off. What the finest material
looks like, and what a belt that is dirty looks like, a single picture cannot tell apart: there the threshold decides.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

CELL = 8
"""Side of a cell, reduced pixels."""
_FINE, _BAND = 3, 9
"""Sides of the boxes whose means the band lies between: neither noise nor slopes of light are texture."""
_OF_NOISE = (_FINE**-2 - _BAND**-2) / (1.0 - _FINE**-2)
"""Energy of white noise in that band over its energy in what is finer."""


class CoverMeter:
    """The share of a region that is covered; `mask` (h, w) is above 0 inside its polygon in the reduced picture."""

    def __init__(self, mask: Image, weight: NDArray[np.float32] | None = None) -> None:
        """`weight` (h, w) is how much each pixel counts, such as the ground that it shows; None: all the same."""
        seen = mask > 0 if weight is None else (mask > 0) & (weight > 0)
        # Next to its edge a cell shows the edge: the wall, or the lip.
        inner = cv2.erode(
            seen.astype(np.uint8), np.ones((_BAND, _BAND), np.uint8), borderType=cv2.BORDER_REPLICATE
        )
        inside = (inner if 4 * inner.sum() >= seen.sum() else seen).astype(np.float32)
        self._rows, self._columns = mask.shape[0] // CELL, mask.shape[1] // CELL
        if not self._rows or not self._columns:
            raise ValueError("the region is too small to see its load")
        whole = self._cells(inside) > 0.75
        counts = self._cells(inside if weight is None else inside * weight)
        self._weight = np.where(whole, counts, 0.0).astype(np.float32)
        if not self._weight.any():
            self._weight = counts
        total = float(self._weight.sum())
        if not total > 0:
            raise ValueError("nothing of the region is to be looked at")
        self._weight /= total

    @property
    def middles(self) -> NDArray[np.float64]:
        """Middle of each cell, row by row, reduced pixels (cells, 2)."""
        y, x = np.mgrid[: self._rows, : self._columns]
        return (np.column_stack([x.ravel(), y.ravel()]) + 0.5) * CELL

    def contrast(self, reduced: Image) -> NDArray[np.float32]:
        """Deviation of each cell over its mean brightness, a reduced picture's (rows, columns)."""
        gray = reduced.astype(np.float32)
        fine = cv2.blur(gray, (_FINE, _FINE))
        coarse = fine - cv2.blur(gray, (_BAND, _BAND))
        finest = gray - fine
        energy = self._cells(coarse * coarse) - _OF_NOISE * self._cells(finest * finest)
        deviation = np.sqrt(np.maximum(energy, 0.0))
        return np.asarray(deviation / np.maximum(self._cells(gray), 8.0), np.float32)

    def covered(self, reduced: Image, bare_below: float) -> float:
        """Share of the region whose contrast is not below `bare_below`."""
        return float(self._weight[self.contrast(reduced) >= bare_below].sum())

    def _cells(self, picture: cv2.typing.MatLike) -> NDArray[np.float32]:
        part = picture[: self._rows * CELL, : self._columns * CELL]
        return np.asarray(
            cv2.resize(part, (self._columns, self._rows), interpolation=cv2.INTER_AREA), np.float32
        )
