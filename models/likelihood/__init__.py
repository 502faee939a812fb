"""Likelihoods: from a picture to the log likelihood ratio of a state (paper 1, Eq. 15).

A `Likelihood` looks at the picture once (`observe`); the `Observation` that it gives is asked about any number of
states. `LumpLikelihood` tells a lump from ore by its surface, its outline and what lies around it,
`HistogramLikelihood` compares a box with a reference histogram, `NetworkLikelihood` reads the map of a network of
the user's own.
"""

from lumpwatch.models.likelihood.base import Likelihood, Observation
from lumpwatch.models.likelihood.histogram import HistogramLikelihood
from lumpwatch.models.likelihood.lump import LumpLikelihood
from lumpwatch.models.likelihood.network import NetworkLikelihood

__all__ = ["HistogramLikelihood", "Likelihood", "LumpLikelihood", "NetworkLikelihood", "Observation"]
