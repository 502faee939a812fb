"""Learning patterns: a network with one hidden layer on the measures of boxes, all its numbers at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.learned import LumpFit
from lumpwatch.models.learning.logistic import equal_shares
from lumpwatch.models.likelihood.lump import standardised
from lumpwatch.models.likelihood.patterns import Patterns

_RIDGE = 3e-4
_STEPS = 300
"""More steps fit the boxes at hand better, and others worse."""
_FIRST = 0.1


def learn_patterns(
    found: NDArray[np.float64],
    missed: NDArray[np.float64],
    start: LumpFit,
    count: int,
    rng: np.random.Generator,
) -> LumpFit:
    """Patterns and weights that tell the features `found` on lumps from those `missed` (n, 68), from a `start`.

    A start with other than `count` patterns gets random ones; its other weights are gone on from. Mean and
    scale stay.
    """
    if len(start.patterns.offsets) != count:
        plain = start.weights[: len(start.weights) - len(start.patterns.offsets)]
        directions = _FIRST * rng.standard_normal((count, found.shape[1]))
        weights = np.concatenate([plain, _FIRST * rng.standard_normal(count)])
        start = replace(start, patterns=Patterns(directions, np.zeros(count)), weights=weights)
    boxes = Boxes.of(standardised(np.concatenate([found, missed]), start.mean, start.scale), len(found))
    # Loaded here: only training needs it.
    from scipy.optimize import minimize

    theta = np.concatenate(
        [start.patterns.directions.ravel(), start.patterns.offsets, start.weights, [start.offset]]
    )
    result = minimize(loss, theta, (boxes, count), jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
    directions, offsets, weights, offset = _parts(result.x, count, found.shape[1])
    return replace(start, patterns=Patterns(directions, offsets), weights=weights, offset=offset)


@dataclass(frozen=True, slots=True)
class Boxes:
    """What the network learns from: half as many digits as elsewhere, for there are hundreds of thousands."""

    z: NDArray[np.float32]
    """Standardised features (n, d)."""
    plain: NDArray[np.float32]
    """The same and their squares (n, 2 d)."""
    sign: NDArray[np.float32]
    """1 for a lump, -1 elsewhere (n,)."""
    share: NDArray[np.float32]
    """What each counts: both kinds the same (n,)."""

    @classmethod
    def of(cls, z: NDArray[np.float64], lumps: int) -> Boxes:
        """Boxes with the standardised features z (n, d), of which the first `lumps` show one."""
        is_lump = np.arange(len(z)) < lumps
        single = z.astype(np.float32)
        sign = np.where(is_lump, 1.0, -1.0).astype(np.float32)
        return cls(
            single, np.hstack([single, single * single]), sign, equal_shares(is_lump).astype(np.float32)
        )


def loss(theta: NDArray[np.float64], boxes: Boxes, count: int) -> tuple[float, NDArray[np.float64]]:
    """Mean logistic loss with its ridge, and the slope along all numbers of the network.

    theta is directions (count, d), offsets (count,), weights (2 d + count,) and the offset, one after the other.
    """
    from scipy.special import expit

    z, plain = boxes.z, boxes.plain
    directions, offsets, weights, offset = _parts(theta.astype(np.float32), count, z.shape[1])
    linear, joint = np.split(weights, (plain.shape[1],))
    responses = Patterns(directions, offsets).responses(z)
    margin = boxes.sign * (plain @ linear + responses @ joint + np.float32(offset))
    pull = theta.copy()
    pull[-1] = 0.0
    value = float(boxes.share @ np.logaddexp(np.float32(0.0), -margin)) + 0.5 * _RIDGE * float(pull @ pull)
    per_logit = -boxes.share * boxes.sign * expit(-margin)
    # softsign'(v) = (1 - |softsign(v)|)^2
    per_along = per_logit[:, None] * joint * (1.0 - np.abs(responses)) ** 2
    slope = [(per_along.T @ z).ravel(), per_along.sum(axis=0), per_logit @ plain, per_logit @ responses]
    return value, np.concatenate([*slope, [per_logit.sum()]]).astype(np.float64) + _RIDGE * pull


def _parts(
    theta: NDArray[Any], count: int, measures: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], float]:
    directions, offsets, weights = np.split(theta[:-1], (count * measures, count * (measures + 1)))
    return directions.reshape(count, measures), offsets, weights, float(theta[-1])
