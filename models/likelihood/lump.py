"""Likelihood of a large lump among ore.

A lump differs from the rubble around it: its surface is smoother or rougher, brighter or darker, and
it has an outline. Some features of a box against the ring around it (`lump_features`) are weighed by a
logistic regression, with their squares and products: a smooth surface tells more where the ground is
rough, an edge more where there is little noise. Trained on equally many boxes with and without a lump,
its logit is the log likelihood ratio.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.likelihood.base import LEAST_INSIDE, bounded
from models.likelihood.lump_features import (
    N_FEATURES,
    integrate,
    integrate_broad,
    measure,
    smoothed,
)
from models.roi import View
from models.state import States

WEIGHTS = N_FEATURES * (N_FEATURES + 3) // 2
"""Number of weights: features, squares, products."""
_LIMIT = 3.0  # standard deviations


@dataclass(slots=True)
class LumpLikelihood:
    """A logistic score on the features, tempered and bounded."""

    mean: NDArray[np.float64]
    """Mean of each feature in training (k,)."""
    scale: NDArray[np.float64]
    """Standard deviation of each feature in training (k,)."""
    weights: NDArray[np.float64]
    """Weights of the standardised features, of their squares and products, see `expand` (WEIGHTS,)."""
    offset: float
    evidence: float
    bound: float
    _sums: NDArray[np.uint64] | None = field(default=None, repr=False)
    _broad: NDArray[np.uint64] | None = field(default=None, repr=False)

    def observe(self, view: View) -> LumpObservation:
        """Compute the integral images of the picture."""
        height, width = view.gray.shape
        if self._sums is None or self._broad is None or self._sums.shape[:2] != (height + 1, width + 1):
            self._sums = np.zeros((height + 1, width + 1, 2), np.uint64)
            self._broad = np.zeros((height // 2 + 1, width // 2 + 1, 2), np.uint64)
        integrate(view.gray, self._sums)
        integrate_broad(smoothed(view.gray), self._broad)
        return LumpObservation(self, self._sums, self._broad, view.inside)


@dataclass(frozen=True, slots=True)
class LumpObservation:
    """The integral images of one picture."""

    likelihood: LumpLikelihood
    sums: NDArray[np.uint64]
    """Integral images side by side (h + 1, w + 1, 2): brightness (upper half) with gradient, and squares."""
    broad: NDArray[np.uint64]
    """The same of the smoothed picture: brightness with squares, and gradients across and down."""
    inside: NDArray[np.int32]

    def features(self, states: States) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (n, k) of the states' boxes, and whether each box lies in the polygon (n,)."""
        return _features(self.sums, self.broad, self.inside, states, LEAST_INSIDE)

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered logit (n,); -inf for a box that leaves the polygon."""
        model = self.likelihood
        return _scores(
            self.sums,
            self.broad,
            self.inside,
            states,
            LEAST_INSIDE,
            model.mean,
            model.scale,
            model.weights,
            model.offset,
        )

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        return bounded(self.score(states), self.likelihood.evidence, self.likelihood.bound)


def expand(
    features: NDArray[np.float64], mean: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standardised features (n, k), limited to three standard deviations, their squares, and their products
    two by two in the order of rows of an upper triangle: (n, k (k + 3) / 2).
    """
    z = np.clip((features - mean) / scale, -_LIMIT, _LIMIT)
    first, second = np.triu_indices(z.shape[1], 1)
    return np.hstack([z, z * z, z[:, first] * z[:, second]])


@njit(cache=True)
def _features(sums, broad, inside, states, least_inside):  # type: ignore[no-untyped-def]
    out = np.zeros((len(states), N_FEATURES))
    valid = np.zeros(len(states), dtype=np.bool_)
    for i in range(len(states)):
        valid[i] = measure(sums, broad, inside, states[i], least_inside, out[i])
    return out, valid


@njit(cache=True)
def _scores(sums, broad, inside, states, least_inside, mean, scale, weights, offset):  # type: ignore[no-untyped-def]
    """The features, expanded as by `expand`, times the weights."""
    out = np.full(len(states), -np.inf)
    features = np.empty(N_FEATURES)
    z = np.empty(N_FEATURES)
    for i in range(len(states)):
        if measure(sums, broad, inside, states[i], least_inside, features):
            score = offset
            for k in range(N_FEATURES):
                z[k] = min(max((features[k] - mean[k]) / scale[k], -_LIMIT), _LIMIT)
                score += z[k] * (weights[k] + z[k] * weights[N_FEATURES + k])
            pair = 2 * N_FEATURES
            for k in range(N_FEATURES):
                others = 0.0
                for j in range(k + 1, N_FEATURES):
                    others += weights[pair] * z[j]
                    pair += 1
                score += z[k] * others
            out[i] = score
    return out
