"""What a tracker of many objects says of one of them after a frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackedObject:
    """One object as a tracker has it; lengths in pixels of the picture that the tracker was given."""

    id: int
    """Never given twice by one tracker."""
    box: NDArray[np.float64]
    """Centre x, centre y, width, height (4,)."""
    velocity: NDArray[np.float64]
    """Along x and y (2,), px/s."""
    spread: NDArray[np.float64]
    """Standard deviation of the centre along x and y (2,)."""
    existence: float
    """Probability that the object exists, 0 to 1."""
    confirmed: bool
    """Whether the tracker stands by the object, or still waits for more evidence."""
    model_shares: NDArray[np.float64] = field(default_factory=lambda: np.ones(1))
    """Probability of each motion model (M,), summing to 1."""
    wrong_way: bool = False
    """Whether it moves against the configured direction."""
