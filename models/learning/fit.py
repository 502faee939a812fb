"""Fitting a likelihood to boxes with and without the object.

Positives are the labelled boxes, slightly moved and scaled. Negatives are boxes as the filter itself
would try them, and boxes that lie badly on an object; after each fit those that the present likelihood takes
for the object most readily are added and the fit is repeated (hard-negative mining). With both classes weighing
the same, the logit of a logistic regression is the log likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths
from lumpwatch.models.learning.examples import (
    TRIED,
    LabelledView,
    elsewhere,
    jitter,
    misfits,
    mistaken,
    tempting,
)
from lumpwatch.models.learning.learned import HistogramFit, LumpFit
from lumpwatch.models.learning.logistic import logistic
from lumpwatch.models.learning.patterns import learn_patterns
from lumpwatch.models.likelihood.histogram import Channel, HistogramLikelihood, histogram
from lumpwatch.models.likelihood.lump import (
    FEATURES,
    LumpLikelihood,
    LumpObservation,
    Maps,
    expand,
    neutral,
    standardised,
)
from lumpwatch.models.likelihood.patterns import no_patterns
from lumpwatch.models.state import States

_LUMP_RIDGE = 3e-3
_TRUST = 0.005
"""Ridge towards what is known of lumps elsewhere."""
_PARTS = 2
"""Where something is known, each round looks for mistakes in one of so many parts of the pictures, in turn:
neighbouring ones show nearly the same."""
_NO_RIDGE = 1e-6


Scene = tuple[Sequence[LabelledView], PolygonBirths]
"""Pictures of one region, and where and how large an object may be there."""


def fit_lump(
    scenes: Sequence[Scene],
    rng: np.random.Generator,
    maps: Maps,
    known: LumpFit | None = None,
    rounds: int = 4,
    patterns: int = 0,
) -> LumpFit:
    """Fit the lump likelihood, starting from what is `known` of lumps elsewhere.

    A handful of labelled lumps leaves most directions of the weights open; there, what is known elsewhere holds
    (a Gaussian prior around its weights), and its patterns are taken as they are. Where nothing is known, as many
    `patterns` as asked are learned too. Raises ValueError where no labelled box can be judged.
    """
    asked = neutral(maps)
    seen_once = [
        _Glance(item, births, maps(item.view.gray).astype(np.float16))
        for views, births in scenes
        for item in views
    ]
    nothing = np.empty((0, len(FEATURES)))
    on, beside, badly = [nothing], [nothing], [nothing]
    for item, births, seen in _observed(asked, seen_once):
        on.append(_usable(seen, jitter(item.objects, rng)))
        beside.append(_usable(seen, elsewhere(births.draw(TRIED // 8, rng)[0], item.taken)))
        badly.append(_usable(seen, misfits(item.objects, rng)))
    found = np.concatenate(on)
    if len(found) == 0:
        raise ValueError("no labelled box lies inside the region")
    fit = _fit_features(found, np.concatenate([*beside, *badly]), known)
    part = 1 if known is None else _PARTS
    for k in range(rounds):
        for item, births, seen in _observed(_likelihood(fit, maps), seen_once[k % part :: part] or seen_once):
            beside.append(_usable(seen, mistaken(seen, births, item.taken, rng)))
            badly.append(_usable(seen, tempting(seen, item.objects, rng)))
        missed = np.concatenate([*beside, *badly])
        fit = (
            learn_patterns(found, missed, fit, patterns, rng)
            if patterns
            else _fit_features(found, missed, known)
        )
    return _against_ore(fit, found, np.concatenate(beside))


@dataclass(frozen=True, slots=True)
class _Glance:
    """A picture to learn from, and what the net says of it: it is asked once."""

    item: LabelledView
    births: PolygonBirths
    maps: NDArray[np.float16]


def _observed(
    likelihood: LumpLikelihood, glances: Sequence[_Glance]
) -> Iterator[tuple[LabelledView, PolygonBirths, LumpObservation]]:
    for one in glances:
        expected = one.births.profile.log_size(one.item.view.gray.shape[0])
        seen = likelihood.observe_maps(one.maps.astype(np.float32), one.item.view, expected=expected)
        yield one.item, one.births, seen


def _usable(seen: LumpObservation, states: States) -> NDArray[np.float64]:
    features, valid = seen.features(states)
    return features[valid]


def _likelihood(fit: LumpFit, maps: Maps) -> LumpLikelihood:
    return LumpLikelihood(
        maps, fit.mean, fit.scale, fit.weights, fit.offset, 1.0, np.inf, patterns=fit.patterns
    )


def _fit_features(found: NDArray[np.float64], missed: NDArray[np.float64], known: LumpFit | None) -> LumpFit:
    both = np.concatenate([found, missed])
    is_lump = np.arange(len(both)) < len(found)
    if known is None:
        mean, scale, patterns = both.mean(axis=0), both.std(axis=0) + 1e-6, no_patterns(both.shape[1])
        ridge, towards = _LUMP_RIDGE, None
    else:
        mean, scale, patterns, ridge, towards = known.mean, known.scale, known.patterns, _TRUST, known.weights
    fit = logistic(expand(standardised(both, mean, scale), patterns), is_lump, ridge, towards)
    net = "" if known is None else known.net
    return LumpFit(mean, scale, fit.weights, fit.offset, patterns=patterns, net=net)


def _against_ore(fit: LumpFit, found: NDArray[np.float64], ore: NDArray[np.float64]) -> LumpFit:
    """The fit with its score stretched and shifted so that it tells lumps from ore (Platt 1999).

    Boxes that lie badly on a lump teach where it is, but they are no alternative to its being there: as such they
    would make every lump look doubtful.
    """
    both = np.concatenate([found, ore])
    score = expand(standardised(both, fit.mean, fit.scale), fit.patterns) @ fit.weights + fit.offset
    line = logistic(score[:, None], np.arange(len(both)) < len(found), _NO_RIDGE)
    stretch = float(line.weights[0])
    return replace(fit, weights=stretch * fit.weights, offset=stretch * fit.offset + line.offset)


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
            near.append(seen.distance(jitter(item.objects, rng)))
        far.append(seen.distance(elsewhere(births.draw(TRIED // 8, rng)[0], item.objects)))
    distance = np.concatenate([*near, *far])
    is_object = np.arange(len(distance)) < sum(map(len, near))
    usable_box = distance < 1.0
    # One feature of small scale: a ridge would only flatten the slope.
    fit = logistic(distance[usable_box, None], is_object[usable_box], ridge=1e-5)
    return HistogramFit(reference, fit.offset, float(-fit.weights[0]), channel)
