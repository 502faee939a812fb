"""Likelihood ratio by histogram (paper 1, section 4; Czyz et al. 2007).

The histogram of a box is compared with the object's reference by the squared Bhattacharyya distance
D^2 = 1 - sum_b sqrt(p_b q_b). Its log likelihood ratio is a line in D^2 whose offset and slope are
fitted to boxes with and without the object:

    log L = offset - slope D^2

An integral histogram (Porikli 2005) holds 16 counts for each pixel, so that a box costs four corners
whatever its size. Four counts share one unsigned 64-bit word, 16 bits each. The words wrap around and
counts carry into their neighbours, but all of it cancels in the difference of the corners, which is
exact for boxes of up to 65,535 pixels; larger boxes are cut into strips.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Literal

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import as_probabilities, check_known
from lumpwatch.models.likelihood.base import LEAST_INSIDE, bounded, box_edges, box_inside
from lumpwatch.models.roi import Image, View
from lumpwatch.models.state import States

BINS = 16
Channel = Literal["luma", "colour"]
_WORDS = 4
"""Words of a pixel in the integral histogram."""
_ONES = np.zeros((BINS, _WORDS), np.uint64)
_ONES[np.arange(BINS), np.arange(BINS) // 4] = [1 << 16 * (b % 4) for b in range(BINS)]
"""What one pixel adds to the words."""
_MOST = 65535
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
    interval_s: float | None = None
    """Interval of the frames that `evidence` is the share of; what counts of others grows with the time since the last,
    up to all of it. None: the same of every frame."""
    _scratch: NDArray[np.uint64] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Raises ValueError for a reference that is not (16,) and summing to 1, and numbers out of their range."""
        self.reference = as_probabilities(self.reference, BINS, "reference")
        check_known(self.channel, ("luma", "colour"), "channel")
        if (
            not np.isfinite([self.offset, self.slope]).all()
            or not self.evidence >= 0.0
            or not self.bound > 0.0
            or not (self.interval_s is None or self.interval_s > 0.0)
        ):
            raise ValueError(
                "offset and slope must be finite, evidence not negative, bound and interval positive, "
                f"not {self.offset}, {self.slope}, {self.evidence}, {self.bound} and {self.interval_s}"
            )

    def observe(self, view: View, dt: float = inf) -> HistogramObservation:
        """Build the integral histogram of the picture."""
        bins = bin_image(view, self.channel)
        shape = (bins.shape[0] + 1, bins.shape[1] + 1, _WORDS)
        if self._scratch is None or self._scratch.shape != shape:
            self._scratch = np.zeros(shape, np.uint64)
        integral_histogram(bins, self._scratch)
        share = self.evidence
        if self.interval_s is not None:
            share = min(max(share, 1.0), share * dt / self.interval_s)
        return HistogramObservation(self, self._scratch, view.inside, share)


@dataclass(frozen=True, slots=True)
class HistogramObservation:
    """The integral histogram of one picture."""

    likelihood: HistogramLikelihood
    integral: NDArray[np.uint64]
    inside: NDArray[np.int32]
    share: float
    """Share of the log ratio that counts."""

    def distance(self, states: States) -> NDArray[np.float64]:
        """Squared Bhattacharyya distance (n,) to the reference; 1 for a box that leaves the polygon."""
        return self.distance_to(states, self.likelihood.reference)

    def distance_to(self, states: States, reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same to any histogram (16,)."""
        counts, area = _counts(self.integral, self.inside, states, LEAST_INSIDE)
        overlap = _roots(counts) @ np.sqrt(reference)
        return 1.0 - overlap / np.sqrt(area)

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        model = self.likelihood
        ratio = model.offset - model.slope * self.distance(states)
        return bounded(ratio, self.share, model.bound)


def histogram(integral: NDArray[np.uint64], state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Histogram (16,) of one state's box, summing to 1; zeros for an empty box."""
    box = box_edges(state, 1.0, integral.shape[1] - 1, integral.shape[0] - 1)
    counts = np.zeros(BINS, np.uint32)
    _count(integral, *box, counts)
    return counts / max(counts.sum(), 1.0)


@njit(cache=True)
def integral_histogram(bins, out):  # type: ignore[no-untyped-def]
    """Fill `out` (h + 1, w + 1, 4) with the counts of each bin above and to the left of a pixel."""
    height, width = bins.shape
    for y in range(height):
        row0 = row1 = row2 = row3 = np.uint64(0)
        for x in range(width):
            counts = _ONES[bins[y, x]]
            row0 += counts[0]
            row1 += counts[1]
            row2 += counts[2]
            row3 += counts[3]
            out[y + 1, x + 1, 0] = out[y, x + 1, 0] + row0
            out[y + 1, x + 1, 1] = out[y, x + 1, 1] + row1
            out[y + 1, x + 1, 2] = out[y, x + 1, 2] + row2
            out[y + 1, x + 1, 3] = out[y, x + 1, 3] + row3


@njit(cache=True)
def _count_small(integral, x0, y0, x1, y1, counts):  # type: ignore[no-untyped-def]
    """Write the counts (16,) of a box of at most 65,535 pixels."""
    for k in range(4):
        word = integral[y1, x1, k] - integral[y0, x1, k] - integral[y1, x0, k] + integral[y0, x0, k]
        for j in range(4):
            counts[4 * k + j] = np.uint32(word >> np.uint64(16 * j)) & np.uint32(_MOST)


@njit(cache=True)
def _count(integral, x0, y0, x1, y1, counts):  # type: ignore[no-untyped-def]
    """Write the counts (16,) of a box of any size, strip by strip."""
    part = np.empty_like(counts)
    rows = _MOST // max(x1 - x0, 1)
    counts[:] = 0
    for y in range(y0, y1, rows):
        _count_small(integral, x0, y, x1, min(y + rows, y1), part)
        counts += part


@njit(cache=True)
def _counts(integral, inside, states, least_inside):  # type: ignore[no-untyped-def]
    """Histograms (n, 16) of the boxes and their areas (n,); no counts where a box leaves the polygon."""
    n = len(states)
    boxes, area, counts = np.zeros((n, 4), np.intp), np.ones(n), np.empty((n, 16), np.uint32)
    for i in range(n):
        (x0, y0, x1, y1), share = box_inside(inside, states[i])
        if share >= least_inside and x1 > x0 and y1 > y0:
            boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = x0, y0, x1, y1
            area[i] = (x1 - x0) * (y1 - y0)
    # A loop of its own, so short that the processor fetches the corners of several boxes at once.
    for i in range(n):
        _count_small(integral, boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3], counts[i])
    for large in np.flatnonzero(area > _MOST):
        box = boxes[large]
        _count(integral, box[0], box[1], box[2], box[3], counts[large])
    return counts, area


@njit(cache=True)
def _roots(counts):  # type: ignore[no-untyped-def]
    """Square roots of counts; one plain loop, which compiles to vector instructions."""
    roots = np.empty(counts.shape)
    flat_counts, flat_roots = counts.ravel(), roots.ravel()
    for i in range(len(flat_counts)):
        flat_roots[i] = np.sqrt(np.float64(flat_counts[i]))
    return roots
