"""Running a filter over a scene, what is measured of it, and the choice of the noise level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.filter import JdtFilter
from lumpwatch.models.likelihood import Likelihood
from lumpwatch.models.roi import Roi, View
from lumpwatch.models.state import X, Y
from tests.reproduction.paper1.methods import working_boxes
from tests.reproduction.paper1.scenes import Scene

SETTLED = 15
"""Frames after which evidence has had time to gather, from the paper's Fig. 10."""


HELD = 5
"""Frames from a change of the motion model on over which a filter should keep the object."""


@dataclass(frozen=True, slots=True)
class Run:
    """One filter on one scene."""

    existence: NDArray[np.float64]
    """(n,)"""
    centres: NDArray[np.float64]
    """Estimated centre (n, 2), not a number where there is none."""


@dataclass(frozen=True, slots=True)
class Measures:
    """Figures of one run; not a number where there is nothing to measure."""

    detected: float
    """Share of frames with existence above 0.5 while the object is there."""
    detected_late: float
    """The same after the object's first 15 frames."""
    after_switch: float
    """Share of the five frames from each change of the motion model on in which existence is above 0.5
    and the estimate lies in the object's box."""
    false_alarms: float
    """Share of frames with existence above 0.5 while it is not."""
    first: float
    """Frames from the object's coming to the first detection."""
    error: float
    """Median distance (px) between estimate and truth over the detected frames."""


def run(jdt: JdtFilter, likelihood: Likelihood, views: Sequence[View], interval_s: float, seed: int) -> Run:
    """Filter the pictures of a scene."""
    rng = np.random.default_rng([seed, 7])
    belief = jdt.start(rng)
    existence, centres = np.zeros(len(views)), np.full((len(views), 2), np.nan)
    for i, view in enumerate(views):
        step = jdt.step(belief, likelihood.observe(view), interval_s, rng)
        belief = step.belief
        existence[i] = belief.existence
        if step.estimate is not None:
            centres[i] = step.estimate.mean[[X, Y]]
    return Run(existence, centres)


def measure(result: Run, scene: Scene, roi: Roi) -> Measures:
    """The figures of a run."""
    present = scene.present
    says = result.existence > 0.5
    hit = says & present
    since = np.cumsum(present) - 1  # frames since the object came, while it is there
    late = present & (since >= SETTLED)
    boxes = working_boxes(scene, roi)
    distance = np.linalg.norm(result.centres - boxes[:, :2], axis=1)
    held = hit & (np.abs(result.centres - boxes[:, :2]) <= 0.5 * boxes[:, 2:]).all(axis=1)
    return Measures(
        detected=_share(says, present),
        detected_late=_share(says, late),
        after_switch=_share(held, present & after_switch(scene)),
        false_alarms=_share(says, ~present),
        first=float(since[hit][0]) if hit.any() else float("nan"),
        error=float(np.median(distance[hit])) if hit.any() else float("nan"),
    )


def after_switch(scene: Scene, frames: int = HELD) -> NDArray[np.bool_]:
    """The frames from each change of the motion model on (n,); a bounce is one change."""
    known = scene.labels >= 0
    change = np.zeros(len(known), dtype=np.bool_)
    change[1:] = known[1:] & known[:-1] & (scene.labels[1:] != scene.labels[:-1]) & (scene.labels[1:] > 0)
    return np.convolve(change, np.ones(frames))[: len(change)] > 0


def _share(says: NDArray[np.bool_], where: NDArray[np.bool_]) -> float:
    return float(says[where].mean()) if where.any() else float("nan")
