"""Fitting a likelihood to boxes with and without the object.

Positives are the labelled boxes, slightly moved and scaled. Negatives are boxes as the filter itself
would try them, and boxes on an object that are much too large, too small or beside it; after each fit
those that the present likelihood takes for the object most readily are added and the fit is repeated
(hard-negative mining). With both classes weighing the same, the logit of a logistic regression is the
log likelihood ratio. A few objects do not fix so many weights: the lump's are drawn towards those that
fit many scenes (a Gaussian prior around them), and the pictures are also seen in another light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.births import PolygonBirths
from models.learning.augment import altered
from models.learning.learned import HistogramFit, LumpFit
from models.likelihood.histogram import Channel, HistogramLikelihood, histogram
from models.likelihood.lump import WEIGHTS, LumpLikelihood, expand
from models.likelihood.lump_features import FEATURES
from models.roi import View
from models.state import H, States, W, X, Y

_JITTERED = 4
_MISPLACED = 8
_MISPLACED_OVERLAP = 0.45
_TRIED = 400
_HARDEST = 6
_NEAR_VIEWS, _LEAST_QUIET_VIEWS = 20, 50
_STEPS = 150
_MOST_OVERLAP = 0.25
_RIDGE = 1e-2


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
    towards: LogisticFit | None = None,
    start: LogisticFit | None = None,
) -> LogisticFit:
    """Fit with both classes weighing the same and a ridge on the weights, or on their distance to others.

    Raises ValueError where one class is missing.
    """
    if not y.any() or y.all():
        raise ValueError("both boxes with and boxes without the object are needed")
    weight = np.where(y, 0.5 / y.sum(), 0.5 / (~y).sum())
    sign = np.where(y, 1.0, -1.0)
    centre = np.zeros(x.shape[1]) if towards is None else towards.weights

    # Loaded here: half of what a monitor would load, and only training needs it.
    from scipy.optimize import minimize
    from scipy.special import expit

    def loss(theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin, away = sign * (x @ theta[:-1] + theta[-1]), theta[:-1] - centre
        value = float(weight @ np.logaddexp(0.0, -margin)) + 0.5 * ridge * float(away @ away)
        slope = -weight * sign * expit(-margin)
        return value, np.append(x.T @ slope + ridge * away, slope.sum())

    begin = start or towards or LogisticFit(centre, 0.0)
    first = np.append(begin.weights, begin.offset)
    found = minimize(loss, first, jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
    return LogisticFit(found.x[:-1], float(found.x[-1]))


def fit_lump(
    views: Sequence[LabelledView],
    births: PolygonBirths | Sequence[PolygonBirths],
    rng: np.random.Generator,
    rounds: int = 3,
    towards: LumpFit | None = None,
    ridge: float = _RIDGE,
    quiet: float | None = None,
) -> LumpFit:
    """Fit the lump likelihood; raises ValueError where no labelled box can be judged.

    `births` draws the boxes that are tried: one for all views, or one for each. With `quiet` the score is
    lowered until in that share of the pictures no box away from the objects has a positive one: what is
    seen of background in one place stays the same from frame to frame, and evidence gathers without end.
    """
    n = len(FEATURES)
    neutral = LumpLikelihood(np.zeros(n), np.ones(n), np.zeros(WEIGHTS), 0.0, 1.0, np.inf)
    laws = [births] * len(views) if isinstance(births, PolygonBirths) else list(births)
    seen_views = [*views, *(replace(item, view=altered(item.view, rng)) for item in views)]
    laws = [*laws, *laws]
    positive, negative = [np.empty((0, n))], []
    for item, law in zip(seen_views, laws, strict=True):
        seen = neutral.observe(item.view)
        if len(item.objects):
            features, valid = seen.features(_jitter(item.objects, rng))
            positive.append(features[valid])
            features, valid = seen.features(_misplaced(item.objects, rng))
            negative.append(features[valid])
        features, valid = seen.features(_elsewhere(law.draw(_TRIED // 20, rng)[0], item.objects))
        negative.append(features[valid])
    found, missed = np.concatenate(positive), np.concatenate(negative)
    if len(found) == 0:
        raise ValueError("no labelled box lies inside the region")
    model = _fit_features(found, missed, towards, ridge)
    for _ in range(rounds):
        hard = []
        for item, law in zip(seen_views, laws, strict=True):
            seen = model.observe(item.view)
            tried = _elsewhere(law.draw(_TRIED, rng)[0], item.objects)
            if len(item.objects):
                tried = np.concatenate([tried, _misplaced(item.objects, rng)])
            features, valid = seen.features(tried)
            score = np.where(valid, seen.score(tried), -np.inf)
            worst = np.argsort(score)[-_HARDEST:]
            hard.append(features[worst[np.isfinite(score[worst])]])
        missed = np.concatenate([missed, *hard])
        model = _fit_features(found, missed, towards, ridge, model)
    fit = LumpFit(model.mean, model.scale, model.weights, model.offset)
    return fit if quiet is None else lowered(fit, views, laws[: len(views)], quiet, rng)


def lowered(
    fit: LumpFit,
    views: Sequence[LabelledView],
    laws: Sequence[PolygonBirths],
    quiet: float,
    rng: np.random.Generator,
) -> LumpFit:
    """The fit with its score lowered, never raised, see `fit_lump`; `laws` draws the boxes of each view.

    Pictures near labelled ones are left out where others are left: an object that is half out of the
    picture has no label yet. A minute shows no rare picture, so the tail beyond a tenth of the views is
    taken for an exponential through what a tenth and a hundredth of them exceed.
    """
    model = LumpLikelihood(fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf)
    best = []
    busy = np.convolve([len(item.objects) > 0 for item in views], np.ones(2 * _NEAR_VIEWS + 1), "same") > 0.5
    if (~busy).sum() < _LEAST_QUIET_VIEWS:
        busy = np.zeros(len(views), np.bool_)
    for item, law, skip in zip(views, laws, busy, strict=True):
        if skip:
            continue
        tried = _elsewhere(law.draw(3 * _TRIED, rng)[0], item.objects)
        score = model.observe(item.view).score(tried)
        if np.isfinite(score).any():
            best.append(float(score.max()))
    if not best:
        return fit
    tenth, hundredth = (float(q) for q in np.quantile(best, (0.9, 0.99)))
    level = tenth + (hundredth - tenth) * (-np.log10(1.0 - quiet) - 1.0)
    return replace(fit, offset=fit.offset - max(level, 0.0))


def _fit_features(
    found: NDArray[np.float64],
    missed: NDArray[np.float64],
    towards: LumpFit | None,
    ridge: float,
    before: LumpLikelihood | None = None,
) -> LumpLikelihood:
    both = np.concatenate([found, missed])
    is_lump = np.arange(len(both)) < len(found)
    if towards is None:
        mean, scale, centre = both.mean(axis=0), both.std(axis=0) + 1e-6, None
        if before is not None:
            mean, scale = before.mean, before.scale
    else:
        mean, scale = towards.mean, towards.scale
        centre = LogisticFit(towards.weights, towards.offset)
    start = None if before is None else LogisticFit(before.weights, before.offset)
    fit = logistic(expand(both, mean, scale), is_lump, ridge, centre, start)
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


def _misplaced(objects: States, rng: np.random.Generator) -> States:
    """Boxes on the objects of a wrong size or place, so that the best box is the right one."""
    moved = np.repeat(objects, _MISPLACED, axis=0)
    n = len(moved)
    moved[:, X : Y + 1] += 0.3 * moved[:, W : H + 1] * rng.standard_normal((n, 2))
    moved[:, W : H + 1] *= np.exp(0.4 * rng.standard_normal((n, 1)) + 0.15 * rng.standard_normal((n, 2)))
    return moved[_overlap(moved, objects).max(axis=1) < _MISPLACED_OVERLAP]


def _elsewhere(states: States, objects: States) -> States:
    """The states whose box overlaps no object by more than a quarter (intersection over union)."""
    if len(objects) == 0:
        return states
    return states[_overlap(states, objects).max(axis=1) < _MOST_OVERLAP]


def _overlap(a: States, b: States) -> NDArray[np.float64]:
    """Intersection over union of all pairs of boxes (n, m)."""
    half_a, half_b = a[:, None, W : H + 1] / 2, b[None, :, W : H + 1] / 2
    centre_a, centre_b = a[:, None, X : Y + 1], b[None, :, X : Y + 1]
    low = np.maximum(centre_a - half_a, centre_b - half_b)
    high = np.minimum(centre_a + half_a, centre_b + half_b)
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    areas = (a[:, W] * a[:, H])[:, None] + (b[:, W] * b[:, H])[None, :]
    return common / np.maximum(areas - common, 1e-9)
