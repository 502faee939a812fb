"""The likelihood that ships with the product."""

from __future__ import annotations

import numpy as np
import pytest

from models.births import polygon_births
from models.learning.examples import elsewhere
from models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN
from models.likelihood.lump import FEATURES, WEIGHTS
from models.profile import default_profile
from models.roi import make_roi
from models.state import H, W, X, Y, blank
from service.config import JdtConfig, LumpConfig
from service.default_lump import DEFAULT_LUMP
from service.detectors.filters import DEFAULT_SPEED_H_S, make_likelihood
from service.feed.simulator import FeedSimulator
from service.feed.spec import FeedSpec


def test_it_is_whole() -> None:
    patterns = DEFAULT_LUMP.patterns
    count = len(patterns.offsets)
    assert count > 0
    assert patterns.directions.shape == (count, len(FEATURES))
    assert DEFAULT_LUMP.weights.shape == (WEIGHTS + count,)
    assert (DEFAULT_LUMP.margin, DEFAULT_LUMP.looks_per_s) == (DEFAULT_MARGIN, DEFAULT_LOOKS_PER_S)
    for numbers in (DEFAULT_LUMP.mean, DEFAULT_LUMP.weights, patterns.directions, patterns.offsets):
        assert np.isfinite(numbers).all()
    assert (DEFAULT_LUMP.scale > 0).all()


@pytest.mark.parametrize("style", ["a", "b"])
def test_it_ranks_lumps_of_a_feed_it_has_not_seen_above_other_boxes(style: str) -> None:
    """The probability that a box on a lump scores above a box elsewhere."""
    spec = FeedSpec.model_validate({"seed": 77, "style": style})
    feed = FeedSimulator(spec)
    roi = make_roi(feed.polygon, spec.width, spec.height, JdtConfig().working_size_px)
    likelihood = make_likelihood(JdtConfig(likelihood=LumpConfig(evidence=1.0, bound=1e6, margin=0.0)), None)
    height = float(roi.shape[0])
    smallest, largest = (size * height for size in JdtConfig().size_h)
    profile = default_profile(height, smallest, largest, DEFAULT_SPEED_H_S * height)
    births, rng = polygon_births(roi.mask, profile, np.ones(1)), np.random.default_rng(1)
    on, off = [], []
    for i in range(600):
        if i % 30:
            feed.skip()
            continue
        picture, truths = feed.render()
        lumps = blank(len(truths))
        if truths:
            lumps[:, [X, Y, W, H]] = roi.to_working(np.array([[t.x, t.y, t.w, t.h] for t in truths]))
        seen = likelihood.observe(roi.view(roi.cut(picture)))
        on.append(seen.log_ratio(lumps))
        off.append(seen.log_ratio(elsewhere(births.draw(200, rng)[0], lumps)))
    lump, other = (np.concatenate(part) for part in (on, off))
    lump, other = lump[lump > -1e6], other[other > -1e6]
    assert len(lump) >= 10
    assert (lump[:, None] > other).mean() > 0.995
