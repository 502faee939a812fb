"""What one object looks like, to tell it from another: a histogram of its box."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.likelihood.histogram import BINS, HistogramLikelihood, HistogramObservation, histogram
from lumpwatch.models.roi import View
from lumpwatch.models.state import States


def _plain() -> HistogramLikelihood:
    return HistogramLikelihood(np.full(BINS, 1 / BINS), 0.0, 1.0, 1.0, np.inf)


@dataclass(slots=True)
class HistogramAppearance:
    """Histograms of brightness of the boxes in one picture after the other."""

    _histograms: HistogramLikelihood = field(default_factory=_plain)

    def observe(self, view: View) -> BoxHistograms:
        """Look at the picture once; what comes back holds until the next call."""
        return BoxHistograms(self._histograms.observe(view))


@dataclass(frozen=True, slots=True)
class BoxHistograms:
    """The boxes of one picture by their histograms; satisfies `lumpwatch.models.jdt.multi_object.Appearance`."""

    observation: HistogramObservation

    def describe(self, state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Histogram (16,) of a state's box."""
        return histogram(self.observation.integral, state)

    def distance(self, states: States, description: NDArray[np.float64]) -> NDArray[np.float64]:
        """Squared Bhattacharyya distance (n,) of the boxes to a description, from 0 to 1."""
        return self.observation.distance_to(states, description)
