"""Likelihood of a large lump among ore.

A lump differs from the rubble around it: its surface is smoother or rougher, brighter or darker, and
it has an outline. Eight measures of a box against the ring around it, and the contrasts of a grid of cells
(`template`), are weighed by a logistic regression, with their squares and with what several of them say
together (`patterns`). Trained on equally many boxes with and without a lump, its logit is the log likelihood
ratio. All features come from integral
images, so a box costs the same whatever its size; all are ratios or differences, so that a change of light
cancels; and nothing outside the polygon counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.likelihood import template
from lumpwatch.models.likelihood.base import LEAST_INSIDE, bounded, box_edges, box_inside, box_sum
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns
from lumpwatch.models.likelihood.sums import PictureSums, brightness_of, sums_of
from lumpwatch.models.likelihood.template import NOISE, contrasts, scratch
from lumpwatch.models.roi import View
from lumpwatch.models.state import States

MEASURES = (
    "brightness",
    "contrast",
    "weakest_side",
    "texture",
    "outline",
    "spread",
    "core_texture",
    "ring_texture",
)
"""Of a box against the ring around it."""
FEATURES = (*MEASURES, *template.NAMES)
"""What `features` tells, in order."""
WEIGHTS = 2 * len(FEATURES)
"""Of the features, and of their squares; further ones are those of patterns."""

_INNER, _RING, _BAND = 0.7, 1.5, 1.2
_LIMIT = 5.0  # standard deviations
_MEASURES, _FEATURES = len(MEASURES), len(FEATURES)
assert _FEATURES % 4 == 0, "the kernel takes four at a time"
_ONE = np.float32(1.0)


@dataclass(slots=True)
class LumpLikelihood:
    """A logistic score on the features, tempered and bounded."""

    mean: NDArray[np.float64]
    """Mean of each feature in training (68,)."""
    scale: NDArray[np.float64]
    """Standard deviation of each feature in training (68,)."""
    weights: NDArray[np.float64]
    """Weights of the standardised features, of their squares, and of the patterns (136 + k,)."""
    offset: float
    evidence: float
    """Share of a frame's log ratio that counts, where `looks_per_s` is not given."""
    bound: float
    looks_per_s: float | None = None
    """How many independent looks a second of frames is worth."""
    patterns: Patterns = field(default_factory=lambda: no_patterns(_FEATURES))
    margin: float = 0.0
    """How far the logit must lie above zero before a box speaks for a lump."""
    _sums: PictureSums = field(default_factory=PictureSums, repr=False)
    _columns: NDArray[np.float32] = field(init=False, repr=False)
    """The patterns' directions as the kernel walks through them (68, k)."""

    def __post_init__(self) -> None:
        self._columns = np.ascontiguousarray(self.patterns.directions.T, np.float32)

    def observe(self, view: View, dt: float = inf) -> LumpObservation:
        """Compute the integral images of the picture."""
        share = self.evidence if self.looks_per_s is None else min(1.0, self.looks_per_s * dt)
        return LumpObservation(self, self._sums.of(view), view.inside, share)


@dataclass(frozen=True, slots=True)
class LumpObservation:
    """The integral images of one picture."""

    likelihood: LumpLikelihood
    sums: NDArray[np.uint64]
    """Integral images side by side (h + 1, w + 1, 3), see `PictureSums.of`."""
    inside: NDArray[np.int32]
    share: float
    """Share of the log ratio that counts: what is new since the last picture."""

    def features(self, states: States) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (n, 68) of the states' boxes, and whether each box lies in the polygon (n,)."""
        return _features(self.sums, self.inside, states, LEAST_INSIDE)

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered logit (n,); -inf for a box that leaves the polygon."""
        model = self.likelihood
        linear, square, joint = np.split(model.weights, (_FEATURES, WEIGHTS))
        return _scores(
            self.sums, self.inside, states, LEAST_INSIDE, model.mean, model.scale, model.offset,
            linear, square, model._columns, model.patterns.offsets, joint,
        )  # fmt: skip

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        model = self.likelihood
        return bounded(self.score(states) - model.margin, self.share, model.bound)


def neutral() -> LumpLikelihood:
    """One without an opinion, to ask for features."""
    n = len(FEATURES)
    return LumpLikelihood(np.zeros(n), np.ones(n), np.zeros(WEIGHTS), 0.0, 1.0, inf)


def standardised(
    features: NDArray[np.float64], mean: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Features (n, 68) in standard deviations from their mean, limited to five of them."""
    return np.clip((features - mean) / scale, -_LIMIT, _LIMIT)


def expand(z: NDArray[np.float64], patterns: Patterns) -> NDArray[np.float64]:
    """What the weights belong to: standardised features, their squares, and the patterns' responses (n, 136 + k)."""
    return np.hstack([z, z * z, patterns.responses(z)])


@njit(cache=True, error_model="numpy")
def _measure(sums, inside, state, least_inside, cells, out):  # type: ignore[no-untyped-def]
    """Write the features (68,) of one state's box; False, and nothing written, where it is no object."""
    if state[6] < 3.0 or state[7] < 3.0:
        return False
    box, share = box_inside(inside, state)
    if share < least_inside:
        return False
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    ring = box_edges(state, _RING, width, height)
    b_in, s_in, g_in, n_in = sums_of(sums, inside, box_edges(state, _INNER, width, height))
    b_box, s_box, g_box, n_box = sums_of(sums, inside, box)
    b_ring, s_ring, g_ring, n_ring = sums_of(sums, inside, ring)
    _, _, g_band, n_band = sums_of(sums, inside, box_edges(state, _BAND, width, height))
    n_in, n_outer = max(n_in, 1.0), max(n_ring - n_box, 1.0)
    mean_in, mean_ring = b_in / n_in, (b_ring - b_box) / n_outer
    spread_in = np.sqrt(max(s_in / n_in - mean_in**2, 0.0))
    noise = np.sqrt(max((s_ring - s_box) / n_outer - mean_ring**2, 0.0)) + NOISE
    left = (ring[0], box[1], box[0], box[3])
    right = (box[2], box[1], ring[2], box[3])
    above = (box[0], ring[1], box[2], box[1])
    below = (box[0], box[3], box[2], ring[3])
    weakest = 1e9
    sign = 1.0 if mean_in >= mean_ring else -1.0
    for side in (left, right, above, below):
        area = box_sum(inside, side[0], side[1], side[2], side[3])
        if area > 0:
            weakest = min(weakest, sign * (mean_in - brightness_of(sums, side) / area) / noise)
    log_in = np.log(g_in / n_in + NOISE)
    log_ring = np.log((g_ring - g_box) / n_outer + NOISE)
    log_band = np.log((g_band - g_in) / max(n_band - n_in, 1.0) + NOISE)
    log_noise = np.log(noise)
    out[0] = (mean_in - mean_ring) / noise
    out[1] = abs(mean_in - mean_ring) / noise
    out[2] = weakest if weakest < 1e9 else 0.0
    out[3] = log_in - log_ring
    out[4] = log_band - log_in
    out[5] = np.log(spread_in + NOISE) - log_noise
    out[6] = log_in - log_noise
    out[7] = log_ring - log_noise
    contrasts(sums, inside, state, cells, out[_MEASURES:])
    return True


@njit(cache=True, error_model="numpy")
def _features(sums, inside, states, least_inside):  # type: ignore[no-untyped-def]
    out = np.zeros((len(states), _FEATURES))
    valid = np.zeros(len(states), dtype=np.bool_)
    cells = scratch()
    for i in range(len(states)):
        valid[i] = _measure(sums, inside, states[i], least_inside, cells, out[i])
    return out, valid


@njit(cache=True, error_model="numpy")
def _scores(  # type: ignore[no-untyped-def]
    sums, inside, states, least_inside, mean, scale, offset, linear, square, directions, offsets, joint
):
    """The features, expanded as by `expand`, times the weights; `directions` are columns (68, k).

    The patterns are most of the arithmetic, and are told in half as many digits: to 1e-5 of the score.
    """
    out = np.full(len(states), -np.inf)
    features, cells, per_scale = np.empty(_FEATURES), scratch(), 1.0 / scale
    z, along = np.empty(_FEATURES, np.float32), np.empty(len(offsets), np.float32)
    for i in range(len(states)):
        if _measure(sums, inside, states[i], least_inside, cells, features):
            score = offset
            for k in range(_FEATURES):
                value = min(max((features[k] - mean[k]) * per_scale[k], -_LIMIT), _LIMIT)
                score += value * (linear[k] + value * square[k])
                z[k] = value
            along[:] = offsets
            # Four at a time, or what is written and read again would take longer than the arithmetic.
            for k in range(0, _FEATURES, 4):
                for p in range(len(along)):
                    along[p] += (z[k] * directions[k, p] + z[k + 1] * directions[k + 1, p]) + (
                        z[k + 2] * directions[k + 2, p] + z[k + 3] * directions[k + 3, p]
                    )
            for p in range(len(along)):
                along[p] /= _ONE + abs(along[p])
            for p in range(len(along)):
                score += joint[p] * along[p]
            out[i] = score
    return out
