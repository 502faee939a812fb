"""What the benchmarks run on: a feed at 320 x 240, and filters over it of any size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import cycle
from typing import Literal

import numpy as np

from lumpwatch.models.jdt.births import polygon_births
from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import JdtFilter
from lumpwatch.models.jdt.motion import ConstantVelocity
from lumpwatch.models.jdt.row_profile import default_profile
from lumpwatch.models.jdt.switching import AdaptiveSwitching
from lumpwatch.models.likelihood import HistogramLikelihood, Likelihood, LumpLikelihood
from lumpwatch.models.likelihood.histogram import BINS
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.models.state import Y
from lumpwatch.service.detection.shipped_likelihood import default_likelihood, make_net
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec

WIDTH, HEIGHT, FPS = 320, 240, 15
INTERVAL_S = 1 / FPS
PICTURES = 60
EVIDENCE, BOUND = 0.3, 4.0
Kind = Literal["lump", "histogram"]
KINDS: tuple[Kind, ...] = ("histogram", "lump")


@cache
def pictures() -> tuple[Image, ...]:
    """Four seconds of the simulated feed, in luma, with a large lump in them."""
    spec = FeedSpec(seed=4, width=WIDTH, height=HEIGHT, fps=FPS, lumps_per_minute=20)
    feed = FeedSimulator(spec)
    feed.skip(5 * FPS)
    return tuple(feed.render()[0] for _ in range(PICTURES))


def whole_roi() -> Roi:
    """A region that covers the whole picture, unscaled: nothing is left out of the work."""
    return make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], WIDTH, HEIGHT, WIDTH)


def make_likelihood(kind: Kind) -> Likelihood:
    """A likelihood with plausible numbers; its cost does not depend on them."""
    if kind == "lump":
        fit = default_likelihood()
        return LumpLikelihood(
            make_net(), fit.mean, fit.scale, fit.weights, fit.offset, EVIDENCE, BOUND, patterns=fit.patterns
        )
    levels = np.exp(-0.5 * ((np.arange(BINS) - 9.0) / 2.0) ** 2)
    return HistogramLikelihood(levels / levels.sum(), 2.0, 12.0, EVIDENCE, BOUND)


def make_filter(particles: int, models: int) -> JdtFilter:
    """Constant velocity models of different noise, adaptive switching over the row (Eq. 12)."""
    roi = whole_roi()
    stay = 0.95 if models > 1 else 1.0
    matrix = np.full((models, models), (1.0 - stay) / max(models - 1, 1))
    np.fill_diagonal(matrix, stay)
    rows = np.linspace(-HEIGHT, 2.0 * HEIGHT, 200)
    centres = HEIGHT * (np.arange(models) + 0.5) / models
    density = np.exp(-0.5 * ((rows - centres[:, None]) / (0.3 * HEIGHT)) ** 2)
    grid = GridDensity((Y,), rows[:1], rows[1:2] - rows[:1], density)
    profile = default_profile(HEIGHT, 24.0, 96.0, 0.5 * HEIGHT)
    return JdtFilter(
        tuple(ConstantVelocity(f"cv{m}", 30.0 * (m + 1)) for m in range(models)),
        AdaptiveSwitching(matrix, INTERVAL_S, np.zeros(models, np.bool_), grid),
        polygon_births(roi.mask, profile, np.full(models, 1.0 / models)),
        profile,
        ExistenceChain(0.1, 0.2),
        particles=particles,
    )


@dataclass(frozen=True)
class Run:
    """A filter that goes on from picture to picture."""

    step: Callable[[], None]
    """Look at the next picture and filter it."""


def make_run(kind: Kind, particles: int, models: int, rois: int = 1, seed: int = 0) -> Run:
    """A full step: integral images, prediction, weights, resampling, estimate; one filter a ROI."""
    region, rng = whole_roi(), np.random.default_rng(seed)
    jdt = make_filter(particles, models)
    likelihoods = [make_likelihood(kind) for _ in range(rois)]
    beliefs = [jdt.start(rng) for _ in range(rois)]
    coming = cycle(pictures())

    def step() -> None:
        view = region.view(next(coming))
        for i, likelihood in enumerate(likelihoods):
            beliefs[i] = jdt.step(beliefs[i], likelihood.observe(view), INTERVAL_S, rng).belief

    return Run(step)
