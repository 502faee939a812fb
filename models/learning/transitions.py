"""What labelled steps teach about switching: P(alpha_{t-1}, alpha_t) and p(x_{t-1} | alpha_t) (Eq. 13, 14)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumpwatch.models.jdt import density
from lumpwatch.models.jdt.switching import Matrix, joint_probabilities
from lumpwatch.models.learning.tracks import Samples
from lumpwatch.models.state import Labels


@dataclass(frozen=True, slots=True)
class TransitionFit:
    """What Eq. 10 and Eq. 12 need."""

    joint: Matrix
    """P(alpha_{t-1}, alpha_t) (M, M)."""
    densities: density.GridDensity


def fit_transitions(
    steps: Samples,
    labels: Labels,
    models: int,
    components: tuple[int, ...],
    least_bandwidth: float,
    rule: density.Bandwidth = "scott",
    *,
    state_first: bool = False,
) -> TransitionFit:
    """Joint probabilities and densities from steps and their labels (k,).

    With `state_first` alpha_{t-1} moves x_t (Eq. 9 literally), so that alpha_t is the model of the step
    after: x_{t-1} is paired with the next step's label. The pairs of labels are the same.
    """
    follows = np.flatnonzero(~steps.starts)
    previous, following = labels[follows - 1], labels[follows]
    states, named = (steps.states[follows - 1], following) if state_first else (steps.states, labels)
    return TransitionFit(
        joint_probabilities(previous, following, models),
        density.learn(states, named, models, components, least_bandwidth, rule),
    )
