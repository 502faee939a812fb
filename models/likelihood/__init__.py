"""Likelihoods: from a picture to the log likelihood ratio of a state (paper 1, Eq. 15).

A likelihood looks at the picture once (`observe`) and is then asked about any number of states.
"""

from lumpwatch.models.likelihood.base import Likelihood, Observation
from lumpwatch.models.likelihood.histogram import HistogramLikelihood
from lumpwatch.models.likelihood.lump import LumpLikelihood
from lumpwatch.models.likelihood.network import NetworkLikelihood

__all__ = ["HistogramLikelihood", "Likelihood", "LumpLikelihood", "NetworkLikelihood", "Observation"]
