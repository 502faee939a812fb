"""Fitting the likelihood that a region asks for to its labelled pictures."""

from __future__ import annotations

import numpy as np

from models.births import polygon_births
from models.learning import HistogramFit, LumpFit, fit_histogram, fit_lump
from models.profile import RowProfile, around_limit
from service.config.jdt import HistogramConfig, JdtConfig
from service.default_lump import DEFAULT_LUMP
from service.footage import Footage, TrainingError


def fit_likelihood(
    config: JdtConfig, footage: Footage, profile: RowProfile, source: str
) -> LumpFit | HistogramFit:
    """Fit the likelihood to the pictures; `profile` is in working pixels. Raises TrainingError, naming `source`."""
    rng = np.random.default_rng(config.seed)
    births = polygon_births(footage.roi.mask, around_limit(profile, footage.roi.limit_px), np.ones(1))
    try:
        if isinstance(config.likelihood, HistogramConfig):
            return fit_histogram(footage.views, births, config.likelihood.channel, rng)
        return fit_lump([(footage.views, births)], rng, DEFAULT_LUMP)
    except ValueError as error:
        raise TrainingError(f"{source}: {error}") from error
