"""Learning patterns: the slope against finite differences, and a law that no sum of single measures can tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.learning import LumpFit
from lumpwatch.models.learning.logistic import logistic
from lumpwatch.models.learning.patterns import Boxes, learn_patterns, loss
from lumpwatch.models.likelihood.lump import expand, standardised
from lumpwatch.models.likelihood.patterns import no_patterns


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_slope_is_that_of_the_loss(seed: int, count: int) -> None:
    """Central differences; single precision leaves three digits of them."""
    rng = np.random.default_rng(seed)
    boxes = Boxes.of(rng.standard_normal((30, 4)), 12)
    theta = rng.standard_normal(count * 4 + count + 8 + count + 1)
    slope = loss(theta, boxes, count)[1]
    for k, towards in enumerate(np.eye(len(theta))):
        rise = loss(theta + 0.01 * towards, boxes, count)[0] - loss(theta - 0.01 * towards, boxes, count)[0]
        assert rise / 0.02 == pytest.approx(slope[k], abs=2e-3)


def test_loss_by_hand() -> None:
    """One box of each kind with z = 1 and -1, one pattern 2 z: responses 2/3 and -2/3, logits +-(1 + 2/3) + 0.5."""
    boxes = Boxes.of(np.array([[1.0], [-1.0]]), 1)
    theta = np.array([2.0, 0.0, 1.0, 0.0, 1.0, 0.5])
    expected = 0.5 * np.log1p(np.exp(-(5 / 3 + 0.5))) + 0.5 * np.log1p(np.exp(-5 / 3 + 0.5))
    assert loss(theta, boxes, 1)[0] == pytest.approx(expected + 0.5 * 3e-4 * 6.0, rel=1e-5)


def test_two_measures_of_the_same_sign() -> None:
    """A lump where both are high or both are low: neither measure alone, nor its square, tells anything."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (4000, 2))
    same = x[:, 0] * x[:, 1] > 0
    plain = logistic(expand(x, no_patterns(2)), same)
    start = LumpFit(np.zeros(2), np.ones(2), plain.weights, plain.offset, patterns=no_patterns(2))
    fit = learn_patterns(x[same], x[~same], start, 4, rng)

    def right(one: LumpFit) -> float:
        z = standardised(fresh, one.mean, one.scale)
        said = expand(z, one.patterns) @ one.weights + one.offset > 0
        return float((said == (fresh[:, 0] * fresh[:, 1] > 0)).mean())

    fresh = rng.uniform(-1.0, 1.0, (4000, 2))
    assert right(start) < 0.6
    assert right(fit) > 0.9


def test_it_goes_on_from_where_it_was() -> None:
    """The same number of patterns again: they are a start, and no worse than it."""
    rng = np.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, (500, 2))
    same = x[:, 0] * x[:, 1] > 0
    start = LumpFit(np.zeros(2), np.ones(2), np.zeros(4), 0.0, patterns=no_patterns(2))
    once = learn_patterns(x[same], x[~same], start, 3, rng)
    random = rng.bit_generator.state
    twice = learn_patterns(x[same], x[~same], once, 3, rng)
    assert rng.bit_generator.state == random
    boxes = Boxes.of(np.concatenate([x[same], x[~same]]), int(same.sum()))

    def value(fit: LumpFit) -> float:
        theta = np.concatenate(
            [fit.patterns.directions.ravel(), fit.patterns.offsets, fit.weights, [fit.offset]]
        )
        return loss(theta, boxes, 3)[0]

    assert value(twice) <= value(once) + 1e-6
