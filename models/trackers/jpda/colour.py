"""Colour of a box as two histograms, and how alike two boxes are (paper 3, Eq. 31-32).

The upper and the lower half of a box each have a histogram p over quantised colours, summing to 1. The
Bhattacharyya distance of two histograms is d = sqrt(1 - rho) with rho = sum over bins sqrt(p q), and
the likelihood of a candidate is exp(-kappa d^2), upper times lower.

The exponential is no density: against clutter it must be a ratio. With d_0 the distance at which
colour says nothing, exp(-kappa (d_upper^2 + d_lower^2 - 2 d_0^2)) is 1 there, more below and less
above, and multiplies a spatial density without changing its unit.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def histograms(picture: NDArray[np.uint8], boxes: Array, bins: int = 8) -> Array:
    """Histograms (n, 2, bins^c) of the upper and lower half of boxes (n, 4), by their centre.

    `picture` is (h, w) or (h, w, 3); a half that lies outside has a flat histogram. Raises ValueError
    for a picture of another kind, or bins that are no power of two up to 16.
    """
    if (
        picture.dtype != np.uint8
        or picture.ndim not in (2, 3)
        or (picture.ndim == 3 and picture.shape[2] != 3)
    ):
        raise ValueError(
            f"the picture must be uint8 (h, w) or (h, w, 3), not {picture.dtype} {picture.shape}"
        )
    if bins not in (2, 4, 8, 16):
        raise ValueError(f"bins must be 2, 4, 8 or 16, not {bins}")
    if boxes.ndim != 2 or boxes.shape[1] != 4 or not np.all(np.isfinite(boxes)):
        raise ValueError("boxes must be finite (n, 4)")
    planes = np.ascontiguousarray(picture if picture.ndim == 3 else picture[:, :, None])
    return _histograms(planes, np.ascontiguousarray(boxes, dtype=float), 8 - int(np.log2(bins)))


def distances(references: Array, candidates: Array) -> Array:
    """Sum of the squared Bhattacharyya distances of both halves (n, m), from 0 to 2."""
    n, m = len(references), len(candidates)
    # The sum over both halves at once: each has a coefficient of at most 1.
    alike = np.sqrt(references).reshape(n, -1) @ np.sqrt(candidates).reshape(m, -1).T
    return np.clip(2.0 - alike, 0.0, 2.0)


def ratio(references: Array, candidates: Array, kappa: float, neutral: float) -> Array:
    """Likelihood ratio (n, m) of candidates (m, 2, b) for targets (n, 2, b); 1 at distance `neutral`."""
    return np.exp(-kappa * (distances(references, candidates) - 2.0 * neutral**2))


@njit(cache=True)
def _histograms(planes, boxes, shift):  # type: ignore[no-untyped-def]
    h, w, channels = planes.shape
    bits = 8 - shift
    size = 1 << (bits * channels)
    counts = np.zeros((len(boxes), 2, size))
    for b in range(len(boxes)):
        x, y, width, height = boxes[b]
        left, right = max(x - width / 2, 0.0), min(x + width / 2, w)
        edges = (max(y - height / 2, 0.0), min(max(y, 0.0), h), min(y + height / 2, h))
        for half in range(2):
            for row in range(round(edges[half]), round(edges[half + 1])):
                for column in range(round(left), round(right)):
                    k = 0
                    for c in range(channels):
                        k = (k << bits) | (planes[row, column, c] >> shift)
                    counts[b, half, k] += 1.0
            total = counts[b, half].sum()
            if total > 0.0:
                counts[b, half] /= total
            else:
                counts[b, half] = 1.0 / size
    return counts
