"""How a likelihood does on labelled objects that it was not trained on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.jdt.births import PolygonBirths
from lumpwatch.models.learning.examples import LabelledView
from lumpwatch.models.likelihood import Likelihood
from lumpwatch.models.state import corners

BOUND = 1e6
"""Bound of a likelihood under test: what lies beyond it was no log ratio but a box outside the polygon."""
MOST_OVERLAP = 0.25
"""A box that overlaps no object by more than this share of both is background."""
_EDGES = np.array([-np.inf, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0, np.inf])


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a likelihood says of one picture."""

    objects: NDArray[np.float64]
    """Log likelihood ratio of each labelled box (n,), NaN where the box cannot be judged."""
    background: NDArray[np.float64]
    """Log likelihood ratios of boxes drawn elsewhere (m,)."""
    hardest: NDArray[np.float64] | None
    """State (8,) of the box of the background with the highest of them; None where there is none."""

    @property
    def hardest_ratio(self) -> float:
        """The highest log likelihood ratio of the background; NaN where there is none."""
        return float(self.background.max()) if len(self.background) else np.nan


def judge(
    likelihood: Likelihood, item: LabelledView, births: PolygonBirths, rng: np.random.Generator, tried: int
) -> Verdict:
    """Ask an untempered likelihood, bounded by BOUND, for the labelled boxes and for `tried` others."""
    seen = likelihood.observe(item.view)
    elsewhere = births.draw(tried, rng)[0]
    if len(item.objects):
        share = overlaps(corners(elsewhere), corners(item.objects)).max(axis=1)
        elsewhere = elsewhere[share < MOST_OVERLAP]
    background = seen.log_ratio(elsewhere)
    inside = np.abs(background) < BOUND
    elsewhere, background = elsewhere[inside], background[inside]
    objects = seen.log_ratio(item.objects) if len(item.objects) else np.empty(0)
    return Verdict(
        np.where(np.abs(objects) < BOUND, objects, np.nan),
        background,
        elsewhere[background.argmax()] if len(background) else None,
    )


@dataclass(frozen=True, slots=True)
class Bin:
    """Boxes whose log likelihood ratios lie close together."""

    predicted: float
    """Mean probability of an object that the ratios say, with even odds before."""
    observed: float
    """Share of objects among the boxes, both classes weighing the same."""
    objects: int
    background: int


def reliability(objects: NDArray[np.float64], background: NDArray[np.float64]) -> tuple[Bin, ...]:
    """Predicted against observed, in bins of the log likelihood ratio that hold any box.

    Raises ValueError where one of the two is missing.
    """
    if len(objects) == 0 or len(background) == 0:
        raise ValueError("both boxes with and boxes without the object are needed")
    bins = []
    for low, high in pairwise(_EDGES):
        these = objects[(objects >= low) & (objects < high)]
        others = background[(background >= low) & (background < high)]
        weights = len(these) / len(objects), len(others) / len(background)
        if sum(weights) == 0.0:
            continue
        predicted = sum(
            float(expit(part).mean()) * weight
            for part, weight in zip((these, others), weights, strict=True)
            if len(part)
        )
        bins.append(Bin(predicted / sum(weights), weights[0] / sum(weights), len(these), len(others)))
    return tuple(bins)


def folds(count: int, wanted: int) -> list[NDArray[np.intp]]:
    """Indices 0 to `count` - 1 in at most `wanted` groups; neighbours lie in different ones."""
    k = min(count, wanted)
    return [np.arange(first, count, k) for first in range(k)]
