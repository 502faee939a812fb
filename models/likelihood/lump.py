"""Likelihood of a large lump among ore.

A lump differs from the rubble around it: its surface is smoother or rougher, brighter or darker, and
it has an outline. A few features of a box against the ring around it are weighed by a logistic
regression. Trained on equally many boxes with and without a lump, its logit is the log likelihood
ratio. All features come from integral images, so a box costs the same whatever its size, and all are
ratios or differences, so that a change of light cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.likelihood.base import LEAST_INSIDE, bounded, box_edges, box_sum, inside_share
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
    bound: float
    _planes: _Planes | None = field(default=None, repr=False)

    def observe(self, view: View) -> LumpObservation:
        """Compute the integral images of the picture."""
        if self._planes is None or self._planes.shape != view.gray.shape:
            self._planes = _Planes(view.gray.shape)
        return LumpObservation(self, self._planes.fill(view.gray), view.inside)


class _Planes:
    """Integral images of brightness, its square and the gradient, in reused memory."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._dx = np.empty(shape, np.int16)
        self._dy = np.empty(shape, np.int16)
        self._gradient = np.empty(shape, np.float32)

    def fill(self, gray: NDArray[np.uint8]) -> tuple[NDArray[np.float64], ...]:
        cv2.Sobel(gray, cv2.CV_16S, 1, 0, dst=self._dx, ksize=3)
        cv2.Sobel(gray, cv2.CV_16S, 0, 1, dst=self._dy, ksize=3)
        _magnitude(self._dx, self._dy, self._gradient)
        brightness, square = cv2.integral2(gray, sdepth=cv2.CV_64F, sqdepth=cv2.CV_64F)
        gradient = cv2.integral(self._gradient, sdepth=cv2.CV_64F)
        return np.asarray(brightness), np.asarray(square), np.asarray(gradient)


@dataclass(frozen=True, slots=True)
class LumpObservation:
    """The integral images of one picture."""

    likelihood: LumpLikelihood
    planes: tuple[NDArray[np.float64], ...]
    inside: NDArray[np.int32]

    def features(self, states: States) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (n, 8) of the states' boxes, and whether each box lies in the polygon (n,)."""
        return _features(*self.planes, self.inside, states, LEAST_INSIDE)

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered logit (n,); -inf for a box that leaves the polygon."""
        model = self.likelihood
        features, valid = self.features(states)
        score: NDArray[np.float64] = expand(features, model.mean, model.scale) @ model.weights + model.offset
        score[~valid] = -np.inf
        return score

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        return bounded(self.score(states), self.likelihood.evidence, self.likelihood.bound)


def expand(
    features: NDArray[np.float64], mean: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standardised features, limited to five standard deviations, and their squares (n, 16)."""
    z = np.clip((features - mean) / scale, -5.0, 5.0)
    return np.hstack([z, z * z])


@njit(cache=True)
def _magnitude(dx, dy, out):  # type: ignore[no-untyped-def]
    height, width = dx.shape
    for y in range(height):
        for x in range(width):
            out[y, x] = 0.25 * (abs(dx[y, x]) + abs(dy[y, x]))


@njit(cache=True)
def _mean(integral, box):  # type: ignore[no-untyped-def]
    x0, y0, x1, y1 = box
    return box_sum(integral, x0, y0, x1, y1) / max((x1 - x0) * (y1 - y0), 1)


@njit(cache=True)
def _mean_between(integral, outer, inner):  # type: ignore[no-untyped-def]
    """Mean over the outer box without the inner one."""
    area = (outer[2] - outer[0]) * (outer[3] - outer[1]) - (inner[2] - inner[0]) * (inner[3] - inner[1])
    total = box_sum(integral, outer[0], outer[1], outer[2], outer[3])
    return (total - box_sum(integral, inner[0], inner[1], inner[2], inner[3])) / max(area, 1)


@njit(cache=True)
def _features(brightness, square, gradient, inside, states, least_inside):  # type: ignore[no-untyped-def]
    n = len(states)
    out = np.zeros((n, 8))
    valid = np.zeros(n, dtype=np.bool_)
    height, width = brightness.shape[0] - 1, brightness.shape[1] - 1
    for i in range(n):
        state = states[i]
        if state[6] < 3.0 or state[7] < 3.0 or inside_share(inside, state) < least_inside:
            continue
        valid[i] = True
        box = box_edges(state, 1.0, width, height)
        inner = box_edges(state, _INNER, width, height)
        ring = box_edges(state, _RING, width, height)
        band = box_edges(state, _BAND, width, height)
        mean_in = _mean(brightness, inner)
        mean_ring = _mean_between(brightness, ring, box)
        var_in = max(_mean(square, inner) - mean_in**2, 0.0)
        var_ring = max(_mean_between(square, ring, box) - mean_ring**2, 0.0)
        texture_in = _mean(gradient, inner)
        texture_ring = _mean_between(gradient, ring, box)
        texture_band = _mean_between(gradient, band, inner)
        noise = np.sqrt(var_ring) + _NOISE
        left = (ring[0], box[1], box[0], box[3])
        right = (box[2], box[1], ring[2], box[3])
        above = (box[0], ring[1], box[2], box[1])
        below = (box[0], box[3], box[2], ring[3])
        weakest = 1e9
        sign = 1.0 if mean_in >= mean_ring else -1.0
        for side in (left, right, above, below):
            if (side[2] - side[0]) * (side[3] - side[1]) > 0:
                weakest = min(weakest, sign * (mean_in - _mean(brightness, side)) / noise)
        out[i, 0] = (mean_in - mean_ring) / noise
        out[i, 1] = abs(mean_in - mean_ring) / noise
        out[i, 2] = weakest if weakest < 1e9 else 0.0
        out[i, 3] = np.log((texture_in + _NOISE) / (texture_ring + _NOISE))
        out[i, 4] = np.log((texture_band + _NOISE) / (texture_in + _NOISE))
        out[i, 5] = np.log((np.sqrt(var_in) + _NOISE) / noise)
        out[i, 6] = np.log((texture_in + _NOISE) / noise)
        out[i, 7] = np.log((texture_ring + _NOISE) / noise)
    return out, valid
