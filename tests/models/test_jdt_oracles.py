"""The filter against exact filters: a grid, a hidden Markov model and a Kalman filter.

Runs with different seeds are independent; their mean is compared with the exact value within four
standard errors plus a stated allowance for the bias of order 1/N that every particle filter has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form, JdtFilter, Order
from lumpwatch.models.jdt.motion import ConstantVelocity
from lumpwatch.models.jdt.resampling import Resampler, multinomial, stratified, systematic
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching, Switching
from lumpwatch.models.state import VX, Belief, States, X, blank
from tests.models.filters import NEVER, belief_of, both_forms, both_orders, make_filter
from tests.models.helpers import Drift, Marker, Seen, births_over, boxes, flat_profile
from tests.models.oracles import LineFilter, assert_agrees, hmm_step, kalman_step

Array = NDArray[np.float64]
DT = 0.5
LENGTH = 60
SEEDS = range(24)

MATRIX = np.array([[0.8, 0.2], [0.1, 0.9]])
BELT_THEN_FALL = GridDensity(
    (X,),
    np.array([-200.0]),
    np.array([200.0]),
    # Knots at -200, 0, 200, 400: m1 fades out along the line, m2 grows.
    np.array([[0.030, 0.020, 0.001, 0.001], [0.001, 0.001, 0.060, 0.060]]),
)


def evidence(t: int) -> Callable[[Array], Array]:
    """Log ratio over x of frame t: slow until frame 5, then fast, and out of sight in frames 3 and 4."""
    place = 15.0 + 0.5 * min(t, 5) + 3.0 * max(t - 5, 0)
    strength = 0.0 if t in (3, 4) else 4.5
    return lambda x: strength * np.exp(-0.5 * ((x - place) / 4.0) ** 2) - 1.5


def along_x(log_ratio: Callable[[Array], Array]) -> Seen:
    """Evidence that depends on x alone."""
    return Seen(lambda states: log_ratio(states[:, X]))


def marks(log_ratio: Array) -> Seen:
    """Evidence that reads the mark of model 0 or 1."""
    return along_x(lambda x: log_ratio[x.astype(int).clip(0, 1)])


def measurement(z: float, noise: float) -> Seen:
    """A position measured with Gaussian noise, up to a factor."""
    return along_x(lambda x: 4.0 - 0.5 * ((x - z) / noise) ** 2)


def exact_line(adaptive: bool, model_first: bool, frames: int) -> Array:
    """Existence, mean of x, share of the second model and log evidence of each frame (frames, 4)."""
    knots = np.arange(-20.0, 110.0, 0.2) + 0.1
    levels = np.ones((len(knots), 2))
    if adaptive:
        at = (-200.0, 0.0, 200.0, 400.0)
        levels = np.column_stack([np.interp(knots, at, row) for row in BELT_THEN_FALL.values])
    rows = MATRIX[:, None, :] * levels[None]
    rows /= rows.sum(axis=2, keepdims=True)
    inside = (knots >= 0) & (knots < LENGTH)
    birth = np.outer((0.7, 0.3), inside / LENGTH)
    p_birth, p_death = ExistenceChain(0.3, 0.2).probabilities(DT)
    line = LineFilter(knots, (1.0, 6.0), (1.5, 2.5), rows, birth, p_birth, p_death, DT, model_first)
    density, existence, seen = birth, 0.0, []
    for t in range(frames):
        density, existence, seen_evidence = line.step(density, existence, np.exp(evidence(t)(knots)))
        given = density * line.cell
        place, share = float(given.sum(axis=0) @ knots), float(given[1].sum())
        seen.append([existence, place, share, np.log(seen_evidence)])
    return np.array(seen)


@pytest.mark.parametrize("adaptive", [False, True], ids=["fixed", "adaptive"])
@both_orders
@both_forms
def test_grid_filter(form: Form, order: Order, adaptive: bool) -> None:
    """Two models drift along a line; births, deaths, switching and evidence as a grid computes them.

    Allowances for the bias: 0.004 of existence, 0.06 px, 0.006 of the share, 0.006 of the log evidence; while
    existence is below 0.1 the sampled form has too few particles alive to judge where they are.
    """
    frames = 12
    exact = exact_line(adaptive, order == "model_first", frames)
    regimes = np.array([False, False])
    switching: Switching = FixedSwitching(MATRIX, DT, regimes)
    if adaptive:
        switching = AdaptiveSwitching(MATRIX, DT, regimes, BELT_THEN_FALL)
    jdt = JdtFilter(
        (Drift("slow", 1.0, 1.5), Drift("fast", 6.0, 2.5)),
        switching,
        births_over(LENGTH, 4, (0.7, 0.3)),
        flat_profile((0.0, 0.0, 2.0, 2.0)),
        ExistenceChain(0.3, 0.2),
        particles=3000,
        form=form,
        order=order,
    )
    runs = np.empty((len(SEEDS), frames, 4))
    for run, seed in enumerate(SEEDS):
        rng = np.random.default_rng(seed)
        belief = jdt.start(rng)
        for t in range(frames):
            step = jdt.step(belief, along_x(evidence(t)), DT, rng)
            belief = step.belief
            x, labels = belief.states[belief.exists, X], belief.labels[belief.exists]
            runs[run, t] = belief.existence, x.mean(), labels.mean(), step.log_evidence
    assert_agrees(runs[:, :, 0], exact[:, 0], 0.004)
    judged = exact[:, 0] >= 0.1
    assert judged.sum() >= 8
    assert exact[-1, 0] > 0.9
    assert_agrees(runs[:, judged, 1], exact[judged, 1], 0.06)
    assert_agrees(runs[:, judged, 2], exact[judged, 2], 0.006)
    assert np.ptp(exact[:, 3]) > 1.0
    assert_agrees(runs[:, :, 3], exact[:, 3], 0.006)


def test_grid_cases_differ() -> None:
    """The oracle tells the orders and the kinds of switching apart by far more than the allowances."""
    cases = [exact_line(adaptive, first, 12) for adaptive in (False, True) for first in (False, True)]
    for i, one in enumerate(cases):
        for other in cases[:i]:
            assert np.abs(one - other)[4:].max(axis=0)[2] > 0.05


EMISSIONS = np.array([[2.0, 0.5], [0.3, 3.0], [1.0, 1.0], [0.2, 2.5], [4.0, 0.1], [1.5, 1.2]])


@both_orders
@both_forms
def test_hidden_markov_model(form: Form, order: Order) -> None:
    """Each model leaves its mark in x and the evidence reads the mark: a two-state hidden Markov model,
    inside a Bernoulli filter without births or deaths. Allowance: 0.002."""
    jdt = JdtFilter(
        (Marker("zero", 0.0), Marker("one", 1.0)),
        FixedSwitching(MATRIX, DT, np.array([False, False])),
        births_over(LENGTH, 4, (0.5, 0.5)),
        flat_profile((0.0, 0.0, 2.0, 2.0)),
        ExistenceChain(1e-12, 1e-12),
        particles=4000,
        form=form,
        order=order,
    )
    exact = np.empty((len(EMISSIONS), 3))
    labels, existence = np.array([0.75, 0.25]), 0.5
    for t, emission in enumerate(EMISSIONS):
        labels, ratio = hmm_step(labels, MATRIX, emission, order == "model_first")
        total = existence * ratio + 1 - existence
        existence = existence * ratio / total
        exact[t] = existence, labels[1], np.log(total)

    n = 4000 if form == "sampled" else 2800
    index = np.arange(n)
    exists = np.ones(n, np.bool_) if form == "marginal" else index % 2 == 0
    start = Belief(boxes(n), (index % 8 >= 6).astype(np.intp), exists, 0.5)
    runs = np.empty((len(SEEDS), len(EMISSIONS), 3))
    for run, seed in enumerate(SEEDS):
        rng, belief = np.random.default_rng(seed), start
        for t, emission in enumerate(EMISSIONS):
            step = jdt.step(belief, marks(np.log(emission)), DT, rng)
            belief = step.belief
            runs[run, t] = belief.existence, belief.labels[belief.exists].mean(), step.log_evidence
    assert_agrees(runs, exact, 0.002)


@pytest.mark.parametrize("resampler", [systematic, stratified, multinomial])
@both_forms
def test_kalman_filter(form: Form, resampler: Resampler) -> None:
    """One object that surely exists, white-noise acceleration, position measured with Gaussian noise.

    Compared: means of position and velocity, their variances and their covariance, and the log evidence, by
    three schemes of resampling. Allowances: 0.05 of the standard deviation for the means, 5 % for the second
    moments, 0.01 for the evidence.
    """
    dt, noise, measured_noise, frames = 0.2, 8.0, 1.5, 15
    truth = np.random.default_rng(99)
    place, speed = 20.0, 6.0
    measured = []
    for _ in range(frames):
        speed += noise * np.sqrt(dt) * truth.standard_normal()
        place += speed * dt
        measured.append(place + measured_noise * truth.standard_normal())
    mean, covariance = np.array([18.0, 0.0]), np.diag([9.0, 64.0])
    exact = np.empty((frames, 6))
    for t, z in enumerate(measured):
        mean, covariance, log_density = kalman_step(mean, covariance, dt, noise, z, measured_noise)
        exact[t, :5] = *mean, covariance[0, 0], covariance[1, 1], covariance[0, 1]
        # What `measurement` leaves out of the Gaussian's density.
        exact[t, 5] = log_density + 4.0 + np.log(np.sqrt(2 * np.pi) * measured_noise)

    jdt = JdtFilter(
        (ConstantVelocity("only", noise),),
        FixedSwitching(np.ones((1, 1)), dt, np.array([False])),
        births_over(LENGTH, 4),
        flat_profile((0.0, 0.0, 2.0, 2.0)),
        ExistenceChain(1e-12, 1e-12),
        particles=4000,
        form=form,
        resampler=resampler,
    )
    n = 4000 if form == "sampled" else 2800
    runs = np.empty((len(SEEDS), frames, 6))
    for run, seed in enumerate(SEEDS):
        rng = np.random.default_rng(seed)
        states: States = blank(n)
        states[:, X] = 18.0 + 3.0 * rng.standard_normal(n)
        states[:, VX] = 8.0 * rng.standard_normal(n)
        belief = Belief(states, np.zeros(n, np.intp), np.ones(n, np.bool_), 1.0)
        for t, z in enumerate(measured):
            step = jdt.step(belief, measurement(z, measured_noise), dt, rng)
            belief = step.belief
            x, v = belief.states[:, X], belief.states[:, VX]
            runs[run, t] = x.mean(), v.mean(), x.var(), v.var(), np.cov(x, v)[0, 1], step.log_evidence
        assert belief.existence == pytest.approx(1.0, abs=1e-9)
    deviation = np.sqrt(exact[:, 2:4])
    assert_agrees(runs[:, :, :2] / deviation, exact[:, :2] / deviation, 0.05)
    assert_agrees(runs[:, :, 2:5] / exact[:, 2:5], np.ones((frames, 3)), 0.05)
    assert_agrees(runs[:, :, 5], exact[:, 5], 0.01)


@both_forms
def test_where_nothing_can_be_right_the_evidence_is_zero(form: Form) -> None:
    """An object that surely exists, and a picture that rules every place out."""
    jdt = make_filter(form=form, chain=NEVER)
    belief = replace(belief_of(jdt, 1.0), existence=1.0)
    step = jdt.step(belief, Seen(lambda states: np.full(len(states), -np.inf)), DT, np.random.default_rng(0))
    assert step.log_evidence == -np.inf if form == "sampled" else step.log_evidence < -20.0
    assert step.estimate is None
