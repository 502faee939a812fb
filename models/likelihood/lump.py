"""Likelihood of a large lump among ore.

A lump differs from the rubble around it: its surface is smoother or rougher, brighter or darker, and
it has an outline. A few features of a box against the ring around it are weighed by a logistic
regression. Trained on equally many boxes with and without a lump, its logit is the log likelihood
ratio. All features come from integral images, so a box costs the same whatever its size, and all are
ratios or differences, so that a change of light cancels.

Two sums share one 64-bit word of the integral image. Words wrap around and the lower sum carries into
the upper one, but all of it cancels in the difference of a box's corners.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.likelihood.base import LEAST_INSIDE, bounded, box_edges, box_inside
from models.roi import View
from models.state import States

FEATURES = (
    "brightness",
    "contrast",
    "weakest_side",
    "texture",
    "outline",
    "spread",
    "core_texture",
    "ring_texture",
)
"""What `features` measures, in order."""

_NOISE = 2.0  # grey levels; keeps ratios of flat patches finite
_INNER, _RING, _BAND = 0.7, 1.5, 1.2
_LIMIT = 5.0  # standard deviations
_UPPER, _LOWER = np.uint64(32), np.uint64(0xFFFFFFFF)


@dataclass(slots=True)
class LumpLikelihood:
    """A logistic score on the features, tempered and bounded."""

    mean: NDArray[np.float64]
    """Mean of each feature in training (8,)."""
    scale: NDArray[np.float64]
    """Standard deviation of each feature in training (8,)."""
    weights: NDArray[np.float64]
    """Weights of the standardised features and of their squares (16,)."""
    offset: float
    evidence: float
    """Share of a frame's log ratio that counts, where `looks_per_s` is not given."""
    bound: float
    looks_per_s: float | None = None
    """How many independent looks a second of frames is worth."""
    _sums: NDArray[np.uint64] | None = field(default=None, repr=False)

    def observe(self, view: View, dt: float = inf) -> LumpObservation:
        """Compute the integral images of the picture."""
        height, width = view.gray.shape
        if self._sums is None or self._sums.shape[:2] != (height + 1, width + 1):
            self._sums = np.zeros((height + 1, width + 1, 2), np.uint64)
        _integrate(view.gray, self._sums)
        share = self.evidence if self.looks_per_s is None else min(1.0, self.looks_per_s * dt)
        return LumpObservation(self, self._sums, view.inside, share)


@dataclass(frozen=True, slots=True)
class LumpObservation:
    """The integral images of one picture."""

    likelihood: LumpLikelihood
    sums: NDArray[np.uint64]
    """Integral images side by side (h + 1, w + 1, 2): brightness (upper half) with gradient, and squares."""
    inside: NDArray[np.int32]
    share: float
    """Share of the log ratio that counts: what is new since the last picture."""

    def features(self, states: States) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (n, 8) of the states' boxes, and whether each box lies in the polygon (n,)."""
        return _features(self.sums, self.inside, states, LEAST_INSIDE)

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered logit (n,); -inf for a box that leaves the polygon."""
        model = self.likelihood
        return _scores(
            self.sums, self.inside, states, LEAST_INSIDE, model.mean, model.scale, model.weights, model.offset
        )

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        return bounded(self.score(states), self.share, self.likelihood.bound)


def expand(
    features: NDArray[np.float64], mean: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standardised features, limited to five standard deviations, and their squares (n, 16)."""
    z = np.clip((features - mean) / scale, -_LIMIT, _LIMIT)
    return np.hstack([z, z * z])


@njit(cache=True)
def _integrate(gray, out):  # type: ignore[no-untyped-def]
    """Integral images of brightness, its square and the gradient (|dx| + |dy| of the neighbours).

    One pass over the picture, the sums of a pixel side by side in memory.
    """
    height, width = gray.shape
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        row, row_of_squares = np.uint64(0), np.uint64(0)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            value = np.uint64(gray[y, x])
            dx = np.int32(gray[y, right]) - np.int32(gray[y, left])
            dy = np.int32(gray[below, x]) - np.int32(gray[above, x])
            row += (value << _UPPER) + np.uint64(abs(dx) + abs(dy))
            row_of_squares += value * value
            out[y + 1, x + 1, 0] = out[y, x + 1, 0] + row
            out[y + 1, x + 1, 1] = out[y, x + 1, 1] + row_of_squares


@njit(cache=True)
def _difference(sums, box, k):  # type: ignore[no-untyped-def]
    x0, y0, x1, y1 = box
    return sums[y1, x1, k] - sums[y0, x1, k] - sums[y1, x0, k] + sums[y0, x0, k]


@njit(cache=True)
def _sums_of(sums, box):  # type: ignore[no-untyped-def]
    """Brightness, square, gradient and area of a box."""
    both, area = _difference(sums, box, 0), (box[2] - box[0]) * (box[3] - box[1])
    return float(both >> _UPPER), float(_difference(sums, box, 1)), float(both & _LOWER), float(area)


@njit(cache=True)
def _brightness(sums, box):  # type: ignore[no-untyped-def]
    """Mean brightness of a box that is not empty."""
    return float(_difference(sums, box, 0) >> _UPPER) / ((box[2] - box[0]) * (box[3] - box[1]))


@njit(cache=True)
def _measure(sums, inside, state, least_inside, out):  # type: ignore[no-untyped-def]
    """Write the features (8,) of one state's box; False, and nothing written, where it is no object."""
    if state[6] < 3.0 or state[7] < 3.0:
        return False
    box, share = box_inside(inside, state)
    if share < least_inside:
        return False
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    ring = box_edges(state, _RING, width, height)
    b_in, s_in, g_in, n_in = _sums_of(sums, box_edges(state, _INNER, width, height))
    b_box, s_box, g_box, n_box = _sums_of(sums, box)
    b_ring, s_ring, g_ring, n_ring = _sums_of(sums, ring)
    _, _, g_band, n_band = _sums_of(sums, box_edges(state, _BAND, width, height))
    n_in, n_outer = max(n_in, 1.0), max(n_ring - n_box, 1.0)
    mean_in, mean_ring = b_in / n_in, (b_ring - b_box) / n_outer
    spread_in = np.sqrt(max(s_in / n_in - mean_in**2, 0.0))
    noise = np.sqrt(max((s_ring - s_box) / n_outer - mean_ring**2, 0.0)) + _NOISE
    left = (ring[0], box[1], box[0], box[3])
    right = (box[2], box[1], ring[2], box[3])
    above = (box[0], ring[1], box[2], box[1])
    below = (box[0], box[3], box[2], ring[3])
    weakest = 1e9
    sign = 1.0 if mean_in >= mean_ring else -1.0
    for side in (left, right, above, below):
        if (side[2] - side[0]) * (side[3] - side[1]) > 0:
            weakest = min(weakest, sign * (mean_in - _brightness(sums, side)) / noise)
    log_in = np.log(g_in / n_in + _NOISE)
    log_ring = np.log((g_ring - g_box) / n_outer + _NOISE)
    log_band = np.log((g_band - g_in) / max(n_band - n_in, 1.0) + _NOISE)
    log_noise = np.log(noise)
    out[0] = (mean_in - mean_ring) / noise
    out[1] = abs(mean_in - mean_ring) / noise
    out[2] = weakest if weakest < 1e9 else 0.0
    out[3] = log_in - log_ring
    out[4] = log_band - log_in
    out[5] = np.log(spread_in + _NOISE) - log_noise
    out[6] = log_in - log_noise
    out[7] = log_ring - log_noise
    return True


@njit(cache=True)
def _features(sums, inside, states, least_inside):  # type: ignore[no-untyped-def]
    out = np.zeros((len(states), 8))
    valid = np.zeros(len(states), dtype=np.bool_)
    for i in range(len(states)):
        valid[i] = _measure(sums, inside, states[i], least_inside, out[i])
    return out, valid


@njit(cache=True)
def _scores(sums, inside, states, least_inside, mean, scale, weights, offset):  # type: ignore[no-untyped-def]
    """The features, expanded as by `expand`, times the weights."""
    out = np.full(len(states), -np.inf)
    features = np.empty(8)
    for i in range(len(states)):
        if _measure(sums, inside, states[i], least_inside, features):
            score = offset
            for k in range(8):
                z = min(max((features[k] - mean[k]) / scale[k], -_LIMIT), _LIMIT)
                score += z * (weights[k] + z * weights[8 + k])
            out[i] = score
    return out
