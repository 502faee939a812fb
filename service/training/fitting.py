"""Fitting the likelihood that a region asks for to its labelled pictures."""

from __future__ import annotations

import numpy as np

from lumpwatch.models.jdt.births import polygon_births
from lumpwatch.models.jdt.row_profile import RowProfile, around_limit
from lumpwatch.models.learning import HistogramFit, LumpFit, fit_histogram, fit_lump
from lumpwatch.models.likelihood.lump import Maps
from lumpwatch.service.config import HistogramConfig, JdtConfig
from lumpwatch.service.detection import default_likelihood, make_net
from lumpwatch.service.training.footage import Footage, TrainingError


def fit_likelihood(
    config: JdtConfig, footage: Footage, profile: RowProfile, source: str, maps: Maps | None = None
) -> LumpFit | HistogramFit:
    """Fit the likelihood to the pictures; `profile` is in working pixels, `maps` stands for the net that ships.

    Raises TrainingError, naming `source`.
    """
    rng = np.random.default_rng(config.seed)
    births = polygon_births(footage.roi.mask, around_limit(profile, footage.roi.limit_px), np.ones(1))
    try:
        if isinstance(config.likelihood, HistogramConfig):
            return fit_histogram(footage.views, births, config.likelihood.channel, rng)
        return fit_lump([(footage.views, births)], rng, maps or make_net(), default_likelihood())
    except ValueError as error:
        raise TrainingError(f"{source}: {error}") from error
