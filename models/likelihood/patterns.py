"""Patterns: what several measures of a box say together.

Three rocks that touch are as bright, as rough and as sharply bounded as one lump; what gives them away is a
crease within, at any of several places. A sum of single measures cannot say "or". So a few directions in the
space of the standardised measures are learned once from many lumps, and how far a box lies along each, squashed
to (-1, 1), is a further number for the logistic regression to weigh (a network with one hidden layer; softsign:
Bergstra, Desjardins, Lamblin, Bengio 2009). A region's own training weighs them anew and leaves the directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Patterns:
    """Directions in the space of the standardised measures."""

    directions: NDArray[np.float64]
    """(k, measures)"""
    offsets: NDArray[np.float64]
    """(k,)"""

    def responses(self, z: NDArray[Any]) -> NDArray[Any]:
        """How far the standardised measures (n, measures) lie along each direction, from -1 to 1 (n, k)."""
        along = z @ self.directions.T + self.offsets
        return along / (1.0 + np.abs(along))


def no_patterns(measures: int) -> Patterns:
    """None at all: a score without them is a plain sum."""
    return Patterns(np.empty((0, measures)), np.empty(0))
