"""Resampling: every scheme unbiased and never a dead particle; the systematic one as even as it can be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lumpwatch.models.jdt.resampling import Resampler, effective_size, multinomial, stratified, systematic

weight_lists = st.lists(st.one_of(st.just(0.0), st.floats(1e-3, 1e3)), min_size=1, max_size=40).filter(
    lambda values: sum(values) > 0
)

every_scheme = pytest.mark.parametrize("scheme", [systematic, stratified, multinomial])


def test_offspring_are_unbiased() -> None:
    """Each particle has floor(N w) or one more offspring, so over K draws the mean has the standard
    error sqrt(f (1 - f) / K) with f the fraction of N w. Six of them for eight particles: a right
    scheme fails with a probability of 8 * 2e-9 < 2e-8."""
    weights = np.array([0.05, 0.31, 0.0, 0.011, 0.2, 0.149, 0.27, 0.01])
    draws, n = 20_000, 10
    counts = np.zeros(len(weights))
    for seed in range(draws):
        counts += np.bincount(systematic(weights, n, np.random.default_rng(seed)), minlength=len(weights))
    expected = n * weights
    fraction = expected - np.floor(expected)
    error = np.sqrt(fraction * (1 - fraction) / draws)
    assert np.all(np.abs(counts / draws - expected) <= 6 * error + 1e-9)


@pytest.mark.parametrize("scheme", [stratified, multinomial])
def test_offspring_of_the_other_schemes_are_unbiased(scheme: Resampler) -> None:
    """Their variance is at most that of independent draws, N w (1 - w); six standard errors as above."""
    weights = np.array([0.05, 0.31, 0.0, 0.011, 0.2, 0.149, 0.27, 0.01])
    draws, n, rng = 20_000, 10, np.random.default_rng(0)
    counts = np.zeros((draws, len(weights)))
    for k in range(draws):
        counts[k] = np.bincount(scheme(weights, n, rng), minlength=len(weights))
    error = np.sqrt(n * weights * (1 - weights) / draws)
    assert np.all(np.abs(counts.mean(axis=0) - n * weights) <= 6 * error + 1e-9)


def test_spread_falls_from_multinomial_to_stratified() -> None:
    """Of one particle with half the weight among many: N w (1 - w) = 5 when drawn independently, and at most
    the 1/4 of the one stratum that it shares when each stratum is drawn by itself."""
    weights, rng = np.array([0.505, *[0.495 / 50] * 50]), np.random.default_rng(1)
    spread = {
        scheme: np.var([np.sum(scheme(weights, 20, rng) == 0) for _ in range(4000)])
        for scheme in (multinomial, stratified)
    }
    assert spread[multinomial] == pytest.approx(5.0, rel=0.15)
    assert spread[stratified] <= 0.25


@given(weight_lists, st.integers(1, 60), st.integers(0, 2**32))
def test_offspring_lie_between_floor_and_ceiling(weights: list[float], n: int, seed: int) -> None:
    w = np.array(weights)
    indices = systematic(w, n, np.random.default_rng(seed))
    counts = np.bincount(indices, minlength=len(w))
    expected = n * w / w.sum()
    assert counts.sum() == n
    assert np.all(counts >= np.floor(expected - 1e-9))
    assert np.all(counts <= np.ceil(expected + 1e-9))
    assert np.all(np.diff(indices) >= 0)


@every_scheme
@given(weights=weight_lists, n=st.integers(1, 200), seed=st.integers(0, 2**32))
def test_particle_without_weight_is_never_drawn(
    scheme: Resampler, weights: list[float], n: int, seed: int
) -> None:
    w = np.array([0.0, *weights, 0.0])
    assert np.all(w[scheme(w, n, np.random.default_rng(seed))] > 0)


@dataclass
class _Fixed:
    """A generator that gives one number."""

    number: float

    def random(self) -> float:
        return self.number


@pytest.mark.parametrize("number", [0.0, float(np.nextafter(1.0, 0.0))], ids=["least", "largest"])
@given(weights=weight_lists, n=st.integers(1, 200))
def test_ends_of_the_comb_stay_on_weight(number: float, weights: list[float], n: int) -> None:
    """The first tooth can stand on zero, before dead particles; rounding can put the last one on the sum
    itself, behind which stand only dead ones."""
    w = np.array([0.0, *weights, 0.0, 0.0])
    assert np.all(w[systematic(w, n, _Fixed(number))] > 0)  # type: ignore[arg-type]


@given(weight_lists, st.integers(0, 2**32), st.integers(-20, 20))
def test_weights_need_not_sum_to_one(weights: list[float], seed: int, power: int) -> None:
    """A power of two changes no mantissa: the same particles are drawn."""
    w = np.array(weights)
    plain = systematic(w, 50, np.random.default_rng(seed))
    assert np.array_equal(systematic(w * 2.0**power, 50, np.random.default_rng(seed)), plain)


@every_scheme
@pytest.mark.parametrize("weights", [[0.0, 0.0], [np.nan, 1.0], [1.0, np.nan], [np.inf, 1.0], [-1.0, 0.5]])
def test_degenerate_weights_are_refused(scheme: Resampler, weights: list[float]) -> None:
    with pytest.raises(ValueError, match="positive, finite sum"):
        scheme(np.array(weights), 5, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([1.0, 1.0, 1.0, 1.0], 4.0),
        ([0.0, 5.0, 0.0], 1.0),
        ([3.0, 1.0], 1.6),  # 16 / 10
        ([1.0, 2.0, 3.0], 36 / 14),
        ([0.0, 0.0], 0.0),
    ],
)
def test_effective_size_by_hand(weights: list[float], expected: float) -> None:
    assert effective_size(np.array(weights)) == pytest.approx(expected, rel=1e-12)


@given(weight_lists)
def test_effective_size_lies_between_one_and_all(weights: list[float]) -> None:
    w = np.array(weights)
    assume(w.max() > 0)
    assert 1 - 1e-9 <= effective_size(w) <= len(w) * (1 + 1e-9)
