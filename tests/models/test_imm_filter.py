"""The filter of paper 2 against hand-worked numbers, Kalman filters and its own promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import ConstantPosition, ConstantVelocity
from lumpwatch.models.state import SIZE, VX, VY, H, W, X, Y, blank
from lumpwatch.models.trackers.imm_pf.filter import ImmBelief, ImmFilter, ImmOptions, estimate, joint_weights
from tests.models.helpers import Marker

Array = NDArray[np.float64]
TWO = (Marker("zero", 0.0), Marker("one", 1.0))
DT = 0.2


def make(labels: list[int], weights: list[float], shares: list[float]) -> ImmBelief:
    return ImmBelief(
        blank(len(labels)), np.array(weights), np.array(labels, dtype=np.intp), np.array(shares), 0
    )


def test_equations_8_and_9_by_hand() -> None:
    """w~ = (.5 .1, .5 .3, .25 .2, .75 .4) = (.05, .15, .05, .3); W = (.2, .35).
    pi = (.6 .2, .4 .35) / .26 = (.12, .14) / .26, and .26 is the mean likelihood."""
    imm = ImmFilter(TWO, ImmOptions(particles=4))
    belief = make([0, 0, 1, 1], [0.5, 0.5, 0.25, 0.75], [0.6, 0.4])
    after, mean = imm.correct(belief, belief.states, np.log([0.1, 0.3, 0.2, 0.4]))
    assert after.weights == pytest.approx([0.25, 0.75, 1 / 7, 6 / 7])
    assert after.shares == pytest.approx([0.12 / 0.26, 0.14 / 0.26])
    assert mean == pytest.approx(np.log(0.26))
    assert after.steps == 1
    assert joint_weights(after).sum() == pytest.approx(1.0)


def test_estimate_is_the_mean_of_equation_6() -> None:
    belief = make([0, 0, 1], [0.25, 0.75, 1.0], [0.4, 0.6])
    belief.states[:, X] = [0.0, 8.0, 10.0]
    found = estimate(belief)
    # 0.4 (0.75 8) + 0.6 10 = 8.4; 0.1 8.4^2 + 0.3 0.4^2 + 0.6 1.6^2 = 8.64
    assert found.mean[X] == pytest.approx(8.4)
    assert found.spread[X] == pytest.approx(np.sqrt(8.64))
    assert found.model_shares == pytest.approx([0.4, 0.6])


def test_tiny_likelihoods_do_not_underflow() -> None:
    imm = ImmFilter(TWO, ImmOptions(particles=4))
    belief = make([0, 0, 1, 1], [0.5, 0.5, 0.5, 0.5], [0.5, 0.5])
    near, _ = imm.correct(belief, belief.states, np.array([-1.0, -2.0, -3.0, -1.5]))
    far, mean = imm.correct(belief, belief.states, np.array([-1.0, -2.0, -3.0, -1.5]) - 5000.0)
    assert far.weights == pytest.approx(near.weights)
    assert far.shares == pytest.approx(near.shares)
    assert mean < -4990.0


def test_impossible_particles() -> None:
    """A model without a possible particle keeps its weights and loses its share; if none is left nothing moves."""
    imm = ImmFilter(TWO, ImmOptions(particles=4))
    belief = make([0, 0, 1, 1], [0.2, 0.8, 0.5, 0.5], [0.3, 0.7])
    one, _ = imm.correct(belief, belief.states, np.array([-np.inf, -np.inf, 0.0, -np.inf]))
    assert one.shares == pytest.approx([0.0, 1.0])
    assert one.weights == pytest.approx([0.2, 0.8, 1.0, 0.0])
    none, mean = imm.correct(belief, belief.states, np.full(4, -np.inf))
    assert mean == -np.inf
    assert none.weights == pytest.approx(belief.weights)
    assert none.shares == pytest.approx(belief.shares)


def test_resampling_over_all_turns_weights_into_numbers() -> None:
    """pi w = (.1, .3, .54, .06): 40 and 60 of 100 particles, and the shares say the same."""
    imm = ImmFilter(TWO, ImmOptions(particles=100, all_every=1, model_every=0))
    labels = np.repeat([0, 0, 1, 1], 25)
    weights = np.repeat([0.25, 0.75, 0.9, 0.1], 25) / 25
    belief = ImmBelief(blank(100), weights, labels, np.array([0.4, 0.6]), 1)
    belief.states[:, X] = np.repeat([0.0, 1.0, 2.0, 3.0], 25)
    after = imm.resample(belief, belief, np.random.default_rng(0))
    assert np.bincount(after.labels) == pytest.approx([40, 60], abs=1)
    assert after.shares == pytest.approx(np.bincount(after.labels) / 100)
    assert np.bincount(after.states[:, X].astype(int)) == pytest.approx([10, 30, 54, 6], abs=1)
    assert after.weights == pytest.approx(1.0 / np.bincount(after.labels)[after.labels])


def test_mean_is_kept_by_resampling() -> None:
    """Unbiased: over 4000 resamplings the mean particle number of each is N pi w within five standard errors,
    which are below 0.5 / sqrt(4000) = 0.008 as systematic resampling rounds up or down."""
    imm = ImmFilter(TWO, ImmOptions(particles=8, all_every=1, model_every=0, least_share=0.0))
    belief = make([0, 0, 0, 0, 1, 1, 1, 1], [0.1, 0.2, 0.3, 0.4, 0.7, 0.1, 0.1, 0.1], [0.35, 0.65])
    belief.states[:, X] = np.arange(8)
    belief = replace(belief, steps=1)
    rng = np.random.default_rng(1)
    total = np.zeros(8)
    for _ in range(4000):
        after = imm.resample(belief, belief, rng)
        total += np.bincount(after.states[:, X].astype(int), minlength=8)
    assert total / 4000 == pytest.approx(8 * joint_weights(belief), abs=0.04)


def test_resampling_within_models_keeps_their_numbers_and_shares() -> None:
    imm = ImmFilter(TWO, ImmOptions(particles=100, all_every=0, model_every=1))
    labels = np.repeat([0, 1], [30, 70])
    weights = np.concatenate([np.arange(30) / 435.0, np.full(70, 1 / 70)])
    belief = ImmBelief(blank(100), weights, labels, np.array([0.9, 0.1]), 1)
    belief.states[:30, X] = np.arange(30)
    after = imm.resample(belief, belief, np.random.default_rng(2))
    assert np.bincount(after.labels).tolist() == [30, 70]
    assert after.shares == pytest.approx([0.9, 0.1])
    assert after.weights[after.labels == 0] == pytest.approx(1 / 30)
    # Particle k has weight k / 435: the mean of x is sum k^2 / 435 = 8555 / 435 = 19.67.
    assert after.states[after.labels == 0, X].mean() == pytest.approx(19.67, abs=0.6)


def test_a_lost_model_comes_back_with_the_least_share() -> None:
    """All the weight on model 0: model 1 gets a tenth, drawn around all particles before the step."""
    imm = ImmFilter(TWO, ImmOptions(particles=4000, all_every=1, model_every=0))
    labels = np.repeat([0, 1], 2000)
    rng = np.random.default_rng(3)
    before = ImmBelief(blank(4000), np.full(4000, 1 / 2000), labels, np.array([0.5, 0.5]), 0)
    before.states[:, [X, Y, VX]] = rng.multivariate_normal(
        [5.0, 7.0, 1.0], [[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]], 4000
    )
    before.states[:, [W, H]] = 10.0, 20.0
    belief = replace(before, shares=np.array([1.0, 0.0]), steps=1)
    after = imm.resample(belief, before, rng)
    assert np.bincount(after.labels).tolist() == [3600, 400]
    assert after.shares == pytest.approx([0.9, 0.1])
    drawn = after.states[after.labels == 1]
    # 400 draws: standard errors 0.1 and 0.05 of the means, 0.28 of the variance of x.
    assert drawn[:, X].mean() == pytest.approx(5.0, abs=0.5)
    assert drawn[:, Y].mean() == pytest.approx(7.0, abs=0.25)
    assert np.cov(drawn[:, X], drawn[:, Y]) == pytest.approx(np.array([[4.0, 1.0], [1.0, 1.0]]), abs=1.4)
    assert drawn[:, VX] == pytest.approx(1.0)
    assert drawn[:, W] == pytest.approx(10.0)


def test_refilling_within_models_raises_the_share() -> None:
    """Model 1 has 2 of 100 particles and no weight; it gets 10 and a tenth, the other two give in proportion."""
    models = (*TWO, Marker("two", 2.0))
    imm = ImmFilter(models, ImmOptions(particles=100, all_every=0, model_every=1))
    labels = np.repeat([0, 1, 2], [70, 2, 28])
    weights = 1.0 / np.bincount(labels)[labels]
    belief = ImmBelief(blank(100), weights, labels, np.array([0.75, 0.0, 0.25]), 1)
    after = imm.resample(belief, belief, np.random.default_rng(4))
    assert np.bincount(after.labels).tolist() == [62, 10, 28]
    assert after.shares == pytest.approx([0.675, 0.1, 0.225])


@settings(max_examples=40, deadline=None)
@given(
    models=st.integers(1, 5),
    particles=st.integers(20, 120),
    all_every=st.integers(0, 3),
    model_every=st.integers(0, 3),
    sharpness=st.floats(0.0, 300.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_number_and_least_number_are_kept(
    models: int, particles: int, all_every: int, model_every: int, sharpness: float, seed: int
) -> None:
    kinds = tuple(ConstantVelocity(f"m{k}", 1.0 + 3.0 * k) for k in range(models))
    options = ImmOptions(particles, all_every, model_every, 0.1)
    imm, rng = ImmFilter(kinds, options), np.random.default_rng(seed)
    belief = imm.start(np.zeros(SIZE), np.ones(SIZE), rng)
    for _ in range(6):
        before = belief
        states = imm.predict(before, DT, rng)
        belief, _ = imm.correct(before, states, -sharpness * (states[:, X] - 1.0) ** 2)
        belief = imm.resample(belief, before, rng)
        numbers = np.bincount(belief.labels, minlength=models)
        assert len(belief.states) == numbers.sum() == particles
        assert numbers.min() >= min(imm.least, particles // models)
        assert belief.shares.sum() == pytest.approx(1.0)
        sums = np.bincount(belief.labels, belief.weights, minlength=models)
        assert sums == pytest.approx(np.ones(models))
        assert np.isfinite(belief.states).all()


def kalman(noise: float, measured: Array, spread: float, position: bool) -> tuple[Array, Array, float]:
    """Means and variances of the position along one axis, and the log likelihood of all measurements."""
    mean, cov = np.zeros(2), np.diag([1.0, 0.0 if position else 1.0])
    if position:
        f, q = np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[noise**2 * DT, 0.0], [0.0, 0.0]])
    else:
        f = np.array([[1.0, DT], [0.0, 1.0]])
        q = noise**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    means, variances, log_likelihood = [], [], 0.0
    for z in measured:
        mean, cov = f @ mean, f @ cov @ f.T + q
        s = cov[0, 0] + spread**2
        log_likelihood += -0.5 * ((z - mean[0]) ** 2 / s + np.log(2 * np.pi * s))
        gain = cov[:, 0] / s
        mean, cov = mean + gain * (z - mean[0]), cov - np.outer(gain, cov[0])
        means.append(mean[0])
        variances.append(cov[0, 0])
    return np.array(means), np.array(variances), log_likelihood


MEASURED = np.array([0.4, 0.9, 1.1, 1.7, 2.6, 2.9])
SPREAD = 0.5


def _play(imm: ImmFilter, rng: np.random.Generator) -> tuple[list[float], list[float], Array]:
    start = np.zeros(SIZE)
    start[[X, VX]] = 1.0  # standard deviations: known along y
    belief = imm.start(np.zeros(SIZE), start, rng)
    means, variances = [], []
    for z in MEASURED:
        before = belief
        states = imm.predict(before, DT, rng)
        log_likelihood = -0.5 * ((z - states[:, X]) ** 2 / SPREAD**2 + np.log(2 * np.pi * SPREAD**2))
        belief, _ = imm.correct(before, states, log_likelihood)
        found = estimate(belief)
        means.append(float(found.mean[X]))
        variances.append(float(found.spread[X] ** 2))
        shares = belief.shares
        belief = imm.resample(belief, before, rng)
    return means, variances, shares


@pytest.mark.parametrize(("all_every", "model_every"), [(0, 0), (1, 0), (0, 1), (4, 5)])
def test_one_model_is_a_kalman_filter(all_every: int, model_every: int) -> None:
    """With 40,000 particles the standard error of a mean is about 0.4 / sqrt(40000 / 4) = 0.004."""
    models = (ConstantVelocity("v", 1.0),)
    imm = ImmFilter(models, ImmOptions(40_000, all_every, model_every))
    means, variances, _ = _play(imm, np.random.default_rng(5))
    exact, spread, _ = kalman(1.0, MEASURED, SPREAD, position=False)
    assert means == pytest.approx(exact, abs=0.03)
    assert variances == pytest.approx(spread, rel=0.06)


@pytest.mark.parametrize("model_every", [0, 1])
def test_model_weights_are_those_of_a_kalman_bank(model_every: int) -> None:
    """Without resampling over all, models do not mix: pi is the posterior of a static bank of Kalman filters."""
    models = (ConstantPosition("p", 1.0), ConstantVelocity("v", 1.0))
    imm = ImmFilter(models, ImmOptions(60_000, 0, model_every))
    _, _, shares = _play(imm, np.random.default_rng(6))
    evidence = np.array([kalman(1.0, MEASURED, SPREAD, position)[2] for position in (True, False)])
    expected = np.exp(evidence - evidence.max())
    expected /= expected.sum()
    assert 0.02 < expected[0] < 0.98
    assert shares == pytest.approx(expected, abs=0.02)


def test_all_models_start_with_equal_numbers() -> None:
    imm = ImmFilter((*TWO, Marker("two", 2.0)), ImmOptions(particles=200))
    belief = imm.start(np.arange(8.0), np.zeros(8), np.random.default_rng(7))
    assert np.bincount(belief.labels).tolist() == [67, 67, 66]
    assert belief.shares == pytest.approx([1 / 3] * 3)
    assert belief.states == pytest.approx(np.tile(np.arange(8.0), (200, 1)))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (ImmOptions(particles=1), "particles"),
        (ImmOptions(least_share=0.6), "least_share"),
        (ImmOptions(least_share=-0.1), "least_share"),
        (ImmOptions(all_every=-1), "negative"),
    ],
)
def test_options_that_cannot_be_meant(options: ImmOptions, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ImmFilter(TWO, options)


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_needs_time(dt: float) -> None:
    imm = ImmFilter(TWO, ImmOptions(particles=4))
    belief = imm.start(np.zeros(SIZE), np.zeros(SIZE), np.random.default_rng(0))
    with pytest.raises(ValueError, match="dt"):
        imm.predict(belief, dt, np.random.default_rng(0))


def test_velocity_along_y_is_left_alone() -> None:
    """The gaussian of a refill keeps a component that no particle has."""
    imm = ImmFilter(TWO, ImmOptions(particles=50, all_every=1))
    belief = imm.start(np.zeros(SIZE), np.zeros(SIZE), np.random.default_rng(8))
    belief = replace(belief, shares=np.array([1.0, 0.0]), steps=1)
    after = imm.resample(belief, belief, np.random.default_rng(8))
    assert np.all(after.states[:, VY] == 0.0)
    assert np.bincount(after.labels).tolist() == [45, 5]
