"""A threshold beyond which a measure lies for a stated share of the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_TAIL = 0.1  # share of the values that counts as the tail


def upper_threshold(values: ArrayLike, share: float) -> float:
    """The value that is exceeded for `share` of the time, also where that is rarer than was seen.

    The excesses over the 90th percentile follow a generalised Pareto distribution (Pickands 1975), fitted
    by probability-weighted moments (Hosking and Wallis 1987) with a shape from -0.5 to 0: all measures are
    bounded. Never below the largest value seen. Raises ValueError without values.
    """
    seen = np.asarray(values, dtype=float)
    if seen.size == 0 or not 0.0 < share < _TAIL:
        raise ValueError(f"needs values and a share between 0 and {_TAIL}")
    start = float(np.quantile(seen, 1.0 - _TAIL))
    excess = np.sort(seen[seen > start] - start)
    largest = float(seen.max())
    if excess.size < 2:
        return largest
    ranks = (np.arange(1, excess.size + 1) - 0.35) / excess.size  # plotting positions
    first, second = float(excess.mean()), float(((1.0 - ranks) * excess).mean())
    shape = min(max(2.0 - first / max(first - 2.0 * second, 1e-12), -0.5), 0.0)
    scale = first * (1.0 - shape)
    beyond = np.log(_TAIL / share) if shape == 0.0 else (1.0 - (share / _TAIL) ** -shape) / -shape
    return max(start + scale * float(beyond), largest)


def lower_threshold(values: ArrayLike, share: float) -> float:
    """The same for values that are too small."""
    return -upper_threshold(-np.asarray(values, dtype=float), share)
