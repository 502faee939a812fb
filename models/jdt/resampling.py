"""Resampling: weights -> indices of the particles that live on.

A scheme is a plain function, a `Resampler`, and an argument of the filters. It is unbiased when particle i
has N w_i offspring on average, as it does in all three here (Douc, Cappé, Moulines 2005):

`systematic`   one uniform number and a regular comb: the least spread of the three, O(N). The comb
               resonates with weights that repeat at a regular distance, so particles should not be
               ordered that way.
`stratified`   one uniform number a tooth: never more spread than multinomial, and no resonance.
`multinomial`  independent draws: the most spread, and the scheme that textbooks analyse.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import check_rng, check_shape

Weights = NDArray[np.float64]
Indices = NDArray[np.intp]
Resampler = Callable[[Weights, int, np.random.Generator], Indices]
"""Draws `n` indices (n,) by weights (m,), which are not negative and need not sum to one.

Raises ValueError where their sum is zero or not finite; those here also for weights with two axes and a seed in the
place of `rng`.
"""


def systematic(weights: Weights, n: int, rng: np.random.Generator) -> Indices:
    """`n` indices drawn by one uniform number and a regular comb (Kitagawa 1996).

    A `Resampler`; the indices come in ascending order.
    """
    cumulative, total = _cumulative(weights, rng)
    return _comb(cumulative, n, rng.random(), total / n)


def stratified(weights: Weights, n: int, rng: np.random.Generator) -> Indices:
    """`n` indices, one drawn uniformly from each n-th of the weights' sum (Kitagawa 1996).

    A `Resampler`; the indices come in ascending order.
    """
    cumulative, total = _cumulative(weights, rng)
    return _under(cumulative, (np.arange(n) + rng.random(n)) * (total / n))


def multinomial(weights: Weights, n: int, rng: np.random.Generator) -> Indices:
    """`n` independent draws (Gordon, Salmond, Smith 1993); a `Resampler`."""
    cumulative, total = _cumulative(weights, rng)
    return _under(cumulative, rng.random(n) * total)


def effective_size(weights: Weights) -> float:
    """Effective number of particles, (sum w)^2 / sum w^2 (Kong 1992)."""
    square = float(np.dot(weights, weights))
    return float(weights.sum()) ** 2 / square if square > 0.0 else 0.0


def _cumulative(weights: Weights, rng: np.random.Generator) -> tuple[Weights, float]:
    if not hasattr(rng, "random"):
        check_rng(rng)
    check_shape(weights, ("m",), "weights")
    cumulative = np.cumsum(weights)
    total = float(cumulative[-1])
    if not np.isfinite(total) or total <= 0.0:
        raise ValueError("weights must have a positive, finite sum")
    return cumulative, total


def _under(cumulative: Weights, places: Weights) -> Indices:
    """The particle under each place; one beyond the sum by rounding belongs to the last with weight."""
    last = int(np.searchsorted(cumulative, cumulative[-1]))
    return np.minimum(np.searchsorted(cumulative, places, side="right"), last)


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
