"""Fitting a likelihood to boxes with and without the object.

Positives are the labelled boxes, slightly moved and scaled. Negatives are boxes as the filter itself
would try them; after each fit those that the present likelihood takes for the object most readily
are added and the fit is repeated (hard-negative mining). With both classes weighing the same, the
logit of a logistic regression is the log likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.births import PolygonBirths
from models.learning.learned import HistogramFit, LumpFit
from models.likelihood.histogram import Channel, HistogramLikelihood, histogram
from models.likelihood.lump import FEATURES, LumpLikelihood, LumpObservation, expand, neutral
from models.roi import View
from models.state import H, States, W, X, Y

_JITTERED = 4
_TRIED = 400
_SEEDS, _CLIMBS, _MOVES, _HARD = 8, 3, 12, 3
_MOVE_S = 0.5  # as far as sizes wander in that time
_MOST_OVERLAP = 0.25
_TOUCHING = 0.1
_TOO_SMALL, _TOO_LARGE = (-0.8, -0.4), (0.4, 0.7)
"""Log of the scale."""
_RIDGE = 1e-2
_LUMP_RIDGE = 3e-3
_TRUST = 0.1
"""Ridge towards what is known of lumps elsewhere."""


@dataclass(frozen=True, slots=True)
class LabelledView:
    """One working picture with the objects in it."""

    view: View
    objects: States
    """States of the labelled objects (n, 8), n may be 0."""


@dataclass(frozen=True, slots=True)
class LogisticFit:
    """A logistic regression: logit = x @ weights + offset."""

    weights: NDArray[np.float64]
    offset: float


def logistic(
    x: NDArray[np.float64],
    y: NDArray[np.bool_],
    ridge: float = _RIDGE,
    towards: NDArray[np.float64] | None = None,
) -> LogisticFit:
    """Fit with both classes weighing the same and a ridge that pulls the weights `towards` some, or to zero.

    Raises ValueError where one class is missing.
    """
    if not y.any() or y.all():
        raise ValueError("both boxes with and boxes without the object are needed")
    weight = np.where(y, 0.5 / y.sum(), 0.5 / (~y).sum())
    sign = np.where(y, 1.0, -1.0)

    # Loaded here: half of what a monitor would load, and only training needs it.
    from scipy.optimize import minimize
    from scipy.special import expit

    known = np.zeros(x.shape[1]) if towards is None else towards

    def loss(theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin, apart = sign * (x @ theta[:-1] + theta[-1]), theta[:-1] - known
        value = float(weight @ np.logaddexp(0.0, -margin)) + 0.5 * ridge * float(apart @ apart)
        slope = -weight * sign * expit(-margin)
        return value, np.append(x.T @ slope + ridge * apart, slope.sum())

    found = minimize(loss, np.append(known, 0.0), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return LogisticFit(found.x[:-1], float(found.x[-1]))


Scene = tuple[Sequence[LabelledView], PolygonBirths]
"""Pictures of one region, and where and how large an object may be there."""


def fit_lump(
    scenes: Sequence[Scene], rng: np.random.Generator, known: LumpFit | None = None, rounds: int = 4
) -> LumpFit:
    """Fit the lump likelihood, starting from what is `known` of lumps elsewhere.

    A handful of labelled lumps leaves most directions of the weights open; there, what is known elsewhere holds
    (a Gaussian prior around its weights). Raises ValueError where no labelled box can be judged.
    """
    asked = neutral()
    nothing = np.empty((0, len(FEATURES)))
    positive, negative = [nothing], [nothing]
    for item, births in _pictures(scenes):
        seen = asked.observe(item.view)
        if len(item.objects):
            features, valid = seen.features(_jitter(item.objects, rng))
            positive.append(features[valid])
        elsewhere = _elsewhere(births.draw(_TRIED // 8, rng)[0], item.objects)
        features, valid = seen.features(np.concatenate([elsewhere, misfits(item.objects, rng)]))
        negative.append(features[valid])
    found, missed = np.concatenate(positive), np.concatenate(negative)
    if len(found) == 0:
        raise ValueError("no labelled box lies inside the region")
    model = _fit_features(found, missed, known)
    for _ in range(rounds):
        hard = []
        for item, births in _pictures(scenes):
            seen = model.observe(item.view)
            hard.append(seen.features(mistaken(seen, births, item.objects, rng))[0])
        missed = np.concatenate([missed, *hard])
        model = _fit_features(found, missed, known)
    return LumpFit(model.mean, model.scale, model.weights, model.offset)


def _pictures(scenes: Sequence[Scene]) -> Iterator[tuple[LabelledView, PolygonBirths]]:
    return ((item, births) for views, births in scenes for item in views)


def mistaken(
    seen: LumpObservation, births: PolygonBirths, objects: States, rng: np.random.Generator
) -> States:
    """Boxes (n, 8) without an object that the likelihood takes for one most readily, n at most `_HARD`.

    Particles gather where the score is best, so these climb too: each of the best boxes of many becomes the
    best of its neighbours, a few times.
    """
    tried = births.draw(_TRIED, rng)[0]
    tried = tried[~_touching(tried, objects)]
    score = seen.score(tried)
    best = tried[np.argsort(-score, kind="stable")[:_SEEDS]]
    for _ in range(_CLIMBS):
        around = np.repeat(best, _MOVES, axis=0)
        moved = around.copy()
        moved[:, X : Y + 1] += 0.1 * around[:, W : H + 1] * rng.standard_normal((len(around), 2))
        births.profile.follow(around, moved, _MOVE_S, rng)
        families = np.concatenate([best[:, None], moved.reshape(len(best), _MOVES, 8)], axis=1)
        score = seen.score(families.reshape(-1, 8))
        score[_touching(families.reshape(-1, 8), objects)] = -np.inf
        score = score.reshape(len(best), -1)
        best, score = families[np.arange(len(best)), score.argmax(axis=1)], score.max(axis=1)
    order = np.argsort(-score, kind="stable")[:_HARD]
    return best[order[np.isfinite(score[order])]]


def _fit_features(
    found: NDArray[np.float64], missed: NDArray[np.float64], known: LumpFit | None
) -> LumpLikelihood:
    both = np.concatenate([found, missed])
    is_lump = np.arange(len(both)) < len(found)
    if known is None:
        mean, scale, ridge, towards = both.mean(axis=0), both.std(axis=0) + 1e-6, _LUMP_RIDGE, None
    else:
        mean, scale, ridge, towards = known.mean, known.scale, _TRUST, known.weights
    fit = logistic(expand(both, mean, scale), is_lump, ridge, towards)
    return LumpLikelihood(mean, scale, fit.weights, fit.offset, 1.0, np.inf)


def fit_histogram(
    views: Sequence[LabelledView], births: PolygonBirths, channel: Channel, rng: np.random.Generator
) -> HistogramFit:
    """Fit reference histogram, offset and slope; raises ValueError where no labelled box is usable."""
    uniform = HistogramLikelihood(np.full(16, 1 / 16), 0.0, 1.0, 1.0, np.inf, channel)
    references = []
    for item in views:
        seen = uniform.observe(item.view)
        references += [histogram(seen.integral, state) for state in item.objects]
    usable = [reference for reference in references if reference.sum() > 0]
    if not usable:
        raise ValueError("no labelled box lies inside the region")
    reference = np.mean(usable, axis=0)
    reference = 0.99 * reference / reference.sum() + 0.01 / 16  # no bin is impossible
    compare = HistogramLikelihood(reference, 0.0, 1.0, 1.0, np.inf, channel)
    near, far = [], []
    for item in views:
        seen = compare.observe(item.view)
        if len(item.objects):
            near.append(seen.distance(_jitter(item.objects, rng)))
        far.append(seen.distance(_elsewhere(births.draw(_TRIED // 8, rng)[0], item.objects)))
    distance = np.concatenate([*near, *far])
    is_object = np.arange(len(distance)) < sum(map(len, near))
    usable_box = distance < 1.0
    # One feature of small scale: a ridge would only flatten the slope.
    fit = logistic(distance[usable_box, None], is_object[usable_box], ridge=1e-5)
    return HistogramFit(reference, fit.offset, float(-fit.weights[0]), channel)


def _jitter(objects: States, rng: np.random.Generator) -> States:
    """Each object a few times, moved and scaled by a few percent of its size."""
    moved = np.repeat(objects, _JITTERED, axis=0)
    n = len(moved)
    moved[:, X : Y + 1] += 0.06 * moved[:, W : H + 1] * rng.standard_normal((n, 2))
    moved[:, W : H + 1] *= np.exp(0.08 * rng.standard_normal((n, 2)))
    return moved


def misfits(objects: States, rng: np.random.Generator) -> States:
    """Boxes on each object that are much too small or too large: they would tell a wrong size."""
    n = len(objects)
    moved = np.repeat(objects, 2, axis=0)
    scale = np.exp(np.column_stack([rng.uniform(*_TOO_SMALL, n), rng.uniform(*_TOO_LARGE, n)])).reshape(-1, 1)
    apart = np.abs(1.0 - scale) * moved[:, W : H + 1]
    moved[:, X : Y + 1] += 0.5 * apart * rng.uniform(-1.0, 1.0, (2 * n, 2))
    moved[:, W : H + 1] *= scale
    return moved


def _elsewhere(states: States, objects: States) -> States:
    """The states whose box overlaps no object by more than a quarter (intersection over union)."""
    if len(objects) == 0:
        return states
    return states[_overlap(states, objects).max(axis=1) < _MOST_OVERLAP]


def _touching(states: States, objects: States) -> NDArray[np.bool_]:
    """Whether more than a tenth of a state's box lies on an object: a part of a lump is no mistake to learn from."""
    if len(objects) == 0:
        return np.zeros(len(states), np.bool_)
    return (_common(states, objects) / np.prod(states[:, None, W : H + 1], axis=-1)).max(axis=1) > _TOUCHING


def _common(a: States, b: States) -> NDArray[np.float64]:
    """The area that boxes have in common, of all pairs (n, m)."""
    half_a, half_b = a[:, None, W : H + 1] / 2, b[None, :, W : H + 1] / 2
    centre_a, centre_b = a[:, None, X : Y + 1], b[None, :, X : Y + 1]
    low = np.maximum(centre_a - half_a, centre_b - half_b)
    high = np.minimum(centre_a + half_a, centre_b + half_b)
    return np.prod(np.maximum(high - low, 0.0), axis=-1)


def _overlap(a: States, b: States) -> NDArray[np.float64]:
    """Intersection over union of all pairs of boxes (n, m)."""
    common = _common(a, b)
    areas = (a[:, W] * a[:, H])[:, None] + (b[:, W] * b[:, H])[None, :]
    return common / np.maximum(areas - common, 1e-9)
