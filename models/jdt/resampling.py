"""Resampling: weights -> indices of the particles that live on.

A scheme is unbiased when particle i has N w_i offspring on average. Systematic resampling has that
property and the least spread of the usual schemes; with sorted uniforms it costs O(N). Its comb
resonates with weights that repeat at a regular distance, so particles should not be ordered that way.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Weights = NDArray[np.float64]
Indices = NDArray[np.intp]


def systematic(weights: Weights, n: int, rng: np.random.Generator) -> Indices:
    """`n` indices drawn by one uniform number and a regular comb (Kitagawa 1996).

    `weights` (m,) are not negative and need not sum to one. Raises ValueError where their sum is
    zero or not finite. The indices come in ascending order.
    """
    cumulative = np.cumsum(weights)
    total = float(cumulative[-1])
    if not np.isfinite(total) or total <= 0.0:
        raise ValueError("weights must have a positive, finite sum")
    return _comb(cumulative, n, rng.random(), total / n)


def effective_size(weights: Weights) -> float:
    """Effective number of particles, (sum w)^2 / sum w^2 (Kong 1992)."""
    square = float(np.dot(weights, weights))
    return float(weights.sum()) ** 2 / square if square > 0.0 else 0.0


@njit(cache=True)
def _comb(cumulative, n, first, distance):  # type: ignore[no-untyped-def]
    """The particle under each of `n` teeth, which stand `distance` apart."""
    indices = np.empty(n, np.intp)
    # The comb's last tooth can pass the sum by rounding; it belongs to the last particle with weight.
    last = len(cumulative) - 1
    while last > 0 and cumulative[last - 1] == cumulative[last]:
        last -= 1
    i = 0
    for tooth in range(n):
        place = (tooth + first) * distance
        while i < last and cumulative[i] <= place:
            i += 1
        indices[tooth] = i
    return indices
