"""The likelihood that ships with the product."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.models.learning.examples import elsewhere
from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN
from lumpwatch.models.likelihood.lump import FEATURES, WEIGHTS
from lumpwatch.service.config import JdtConfig, LumpConfig
from lumpwatch.service.detection.detectors.filters import make_likelihood
from lumpwatch.service.detection.shipped_likelihood import default_likelihood
from lumpwatch.service.simulator.spec import FeedSpec
from tests.reproduction.defaults import default_births, lump_views


def test_it_is_whole() -> None:
    patterns = default_likelihood().patterns
    count = len(patterns.offsets)
    assert count > 0
    assert patterns.directions.shape == (count, len(FEATURES))
    assert default_likelihood().weights.shape == (WEIGHTS + count,)
    assert (default_likelihood().margin, default_likelihood().looks_per_s) == (
        DEFAULT_MARGIN,
        DEFAULT_LOOKS_PER_S,
    )
    for numbers in (
        default_likelihood().mean,
        default_likelihood().weights,
        patterns.directions,
        patterns.offsets,
    ):
        assert np.isfinite(numbers).all()
    assert (default_likelihood().scale > 0).all()


@pytest.mark.parametrize("style", ["a", "b"])
def test_it_ranks_lumps_of_a_feed_it_has_not_seen_above_other_boxes(style: str) -> None:
    """The probability that a box on a lump scores above a box elsewhere."""
    views, roi = lump_views(FeedSpec.model_validate({"seed": 77, "style": style}))
    likelihood = make_likelihood(JdtConfig(likelihood=LumpConfig(evidence=1.0, bound=1e6, margin=0.0)), None)
    births, rng = default_births(roi), np.random.default_rng(1)
    on, off = [], []
    for item in views:
        seen = likelihood.observe(item.view)
        on.append(seen.log_ratio(item.objects))
        off.append(seen.log_ratio(elsewhere(births.draw(200, rng)[0], item.objects)))
    lump, other = (np.concatenate(part) for part in (on, off))
    lump, other = lump[lump > -1e6], other[other > -1e6]
    assert len(lump) >= 10
    assert (lump[:, None] > other).mean() > 0.995
