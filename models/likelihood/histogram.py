"""Likelihood ratio by histogram (paper 1, section 4; Czyz et al. 2007).

The histogram of a box is compared with the object's reference by the squared Bhattacharyya distance
D^2 = 1 - sum_b sqrt(p_b q_b). Its log likelihood ratio is a line in D^2 whose offset and slope are
fitted to boxes with and without the object:

    log L = offset - slope D^2

An integral histogram (Porikli 2005) holds 16 counts for each pixel, so that a box costs four corners
whatever its size.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.likelihood.base import LEAST_INSIDE, bounded, box_edges, inside_share
from models.roi import Image, View
from models.state import States

BINS = 16
Channel = Literal["luma", "colour"]
_GRAY_BINS = 4
_LEAST_SATURATION = 48


def bin_image(view: View, channel: Channel) -> Image:
    """The histogram bin 0-15 of every pixel (h, w).

    luma: 16 levels of brightness. colour: 12 hues, and 4 levels of brightness for pixels with too
    little saturation to have a hue. Raises ValueError where colour is asked of a picture without it.
    """
    if channel == "luma":
        return (view.gray >> 4).astype(np.uint8, copy=False)
    if view.colour is None:
        raise ValueError("the histogram needs colour but the picture holds luma only")
    hsv = np.asarray(cv2.cvtColor(view.colour, cv2.COLOR_BGR2HSV), dtype=np.uint8)
    hue = np.minimum(hsv[..., 0] // 15, 11)  # OpenCV's hue of 8-bit pictures runs from 0 to 179
    grey = 12 + hsv[..., 2] // (256 // _GRAY_BINS)
    return np.where(hsv[..., 1] >= _LEAST_SATURATION, hue, grey).astype(np.uint8)


@dataclass(slots=True)
class HistogramLikelihood:
    """Log likelihood ratio offset - slope D^2, tempered and bounded."""

    reference: NDArray[np.float64]
    """Histogram of the object (16,), summing to 1."""
    offset: float
    slope: float
    evidence: float
    bound: float
    channel: Channel = "luma"
    _scratch: NDArray[np.int32] | None = field(default=None, repr=False)

    def observe(self, view: View) -> HistogramObservation:
        """Build the integral histogram of the picture."""
        bins = bin_image(view, self.channel)
        shape = (bins.shape[0] + 1, bins.shape[1] + 1, BINS)
        if self._scratch is None or self._scratch.shape != shape:
            self._scratch = np.zeros(shape, np.int32)
        integral_histogram(bins, self._scratch)
        return HistogramObservation(self, self._scratch, view.inside)


@dataclass(frozen=True, slots=True)
class HistogramObservation:
    """The integral histogram of one picture."""

    likelihood: HistogramLikelihood
    integral: NDArray[np.int32]
    inside: NDArray[np.int32]

    def distance(self, states: States) -> NDArray[np.float64]:
        """Squared Bhattacharyya distance (n,) to the reference; 1 for a box that leaves the polygon."""
        roots = np.sqrt(self.likelihood.reference)
        return _distances(self.integral, self.inside, states, roots, LEAST_INSIDE)

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        model = self.likelihood
        ratio = model.offset - model.slope * self.distance(states)
        return bounded(ratio, model.evidence, model.bound)


def histogram(integral: NDArray[np.int32], state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Histogram (16,) of one state's box, summing to 1; zeros for an empty box."""
    x0, y0, x1, y1 = box_edges(state, 1.0, integral.shape[1] - 1, integral.shape[0] - 1)
    counts = (integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]).astype(float)
    return counts / max(counts.sum(), 1.0)


@njit(cache=True)
def integral_histogram(bins, out):  # type: ignore[no-untyped-def]
    """Fill `out` (h + 1, w + 1, 16) with the counts of each bin above and to the left of a pixel."""
    height, width = bins.shape
    row = np.zeros(16, np.int32)
    for y in range(height):
        row[:] = 0
        for x in range(width):
            row[bins[y, x]] += 1
            for b in range(16):
                out[y + 1, x + 1, b] = out[y, x + 1, b] + row[b]


@njit(cache=True)
def _distances(integral, inside, states, roots, least_inside):  # type: ignore[no-untyped-def]
    n = len(states)
    out = np.ones(n)
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    for i in range(n):
        if inside_share(inside, states[i]) < least_inside:
            continue
        x0, y0, x1, y1 = box_edges(states[i], 1.0, width, height)
        area = (x1 - x0) * (y1 - y0)
        if area <= 0:
            continue
        overlap = 0.0
        for b in range(16):
            count = integral[y1, x1, b] - integral[y0, x1, b] - integral[y1, x0, b] + integral[y0, x0, b]
            overlap += np.sqrt(count) * roots[b]
        out[i] = 1.0 - overlap / np.sqrt(area)
    return out
