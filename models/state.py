"""The state of a particle and the belief of a filter.

A state is a row of eight numbers: centre, velocity and acceleration, then width and height. The unit
of length is the pixel of the ROI's working picture, the unit of time the second. Row and column
follow the picture: x to the right, y downwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

X, Y, VX, VY, AX, AY, W, H = range(8)
SIZE = 8

States = NDArray[np.float64]
"""Shape (n, 8)."""
Labels = NDArray[np.intp]
"""Shape (n,): the index of each particle's motion model."""


@dataclass(frozen=True, slots=True)
class Belief:
    """What a filter knows after a step: equally weighted particles and the probability of existence."""

    states: States
    labels: Labels
    exists: NDArray[np.bool_]
    """Existence variable of each particle; all true in the marginal form."""
    existence: float
    """P(E = 1), Eq. 16 or its marginal form."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the object is, given that it exists."""

    mean: NDArray[np.float64]
    """State (8,)."""
    spread: NDArray[np.float64]
    """Standard deviation of each component (8,)."""
    model_shares: NDArray[np.float64]
    """Probability of each motion model (M,), summing to 1."""


def blank(n: int) -> States:
    """`n` states of zeros."""
    return np.zeros((n, SIZE))


def scaled(states: States, factor: float) -> States:
    """The same states in a picture scaled by `factor`; every component is a length or a length per time."""
    return states * factor


def corners(states: States) -> NDArray[np.float64]:
    """The states' boxes by their upper left corner and sides (n, 4)."""
    sides = states[:, W : H + 1]
    return np.hstack([states[:, X : Y + 1] - sides / 2, sides])
