"""What the scripts about the bouncing square share: the filter and the likelihood, from one clip's truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from docs.experiments.square.scene import EMPTY, FPS, HEIGHT, SIDE, WIDTH, Scene
from lumpwatch.models import (
    ExistenceChain,
    FixedSwitching,
    HistogramLikelihood,
    JdtFilter,
    Roi,
    default_profile,
    make_roi,
    polygon_births,
)


def region() -> Roi:
    """The whole picture."""
    return make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], width=WIDTH, height=HEIGHT, working_size=WIDTH)


def make_filter(models: Sequence[Any], matrix: NDArray[np.float64], particles: int = 2000) -> JdtFilter:
    """A filter for one square with motion models (M) and a matrix (M, M) of switching from one step to the next."""
    profile = default_profile(HEIGHT, smallest=SIDE - 2, largest=SIDE + 2, speed=150.0)
    momentary = np.array([model.momentary for model in models])
    first = np.where(momentary, 0.0, 1.0)
    return JdtFilter(
        models=tuple(models),
        switching=FixedSwitching(matrix, 1.0 / FPS, momentary),
        births=polygon_births(region().mask, profile, first / first.sum()),
        profile=profile,
        particles=particles,
        chain=ExistenceChain(birth_rate=0.2, death_rate=0.1),
    )


def learned(scene: Scene, evidence: float = 1.0) -> HistogramLikelihood:
    """The square's mean histogram as the reference; offset and slope between it and the ground's."""
    inside: list[NDArray[np.float64]] = []
    outside: list[NDArray[np.float64]] = []
    for k, (x, y) in enumerate(scene.centres):
        bins = scene.pictures[EMPTY + k] >> 4
        for found, left in ((inside, x), (outside, (x + WIDTH / 2) % (WIDTH - SIDE) + SIDE / 2)):
            column, row = int(left - SIDE / 2), int(y - SIDE / 2)
            patch = bins[row : row + SIDE, column : column + SIDE]
            found.append(np.bincount(patch.ravel(), minlength=16) / patch.size)
    reference = np.mean(inside, axis=0)
    near, far = (1.0 - np.mean(np.sqrt(np.array(h)) @ np.sqrt(reference)) for h in (inside, outside))
    slope = 12.0 / (far - near)
    return HistogramLikelihood(reference, 0.5 * slope * (near + far), slope, evidence, bound=6.0)
