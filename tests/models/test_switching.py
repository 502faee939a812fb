"""The motion model prediction function (Eq. 10 to 13)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.stats import chi2

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.switching import (
    AdaptiveSwitching,
    FixedSwitching,
    check_matrix,
    conditional,
    draw,
    joint_probabilities,
    over_interval,
)
from lumpwatch.models.state import X
from tests.models.helpers import boxes, level_density

Array = NDArray[np.float64]
TABLE_1 = np.array([[0.94, 0.03], [0.0, 0.03]])
"""The paper's joint probabilities P(alpha_{t-1}, alpha_t)."""
REGIMES = np.array([False, False])


def adaptive(density: GridDensity) -> AdaptiveSwitching:
    return AdaptiveSwitching(conditional(TABLE_1), 0.04, REGIMES, density)


@st.composite
def chains(draw_: st.DrawFn) -> Array:
    """A random transition matrix, with some empty cells."""
    models = draw_(st.integers(1, 4))
    cells = st.one_of(st.just(0.0), st.floats(0.01, 1.0))
    weights = draw_(arrays(float, (models, models), elements=cells)) + 0.05 * np.eye(models)
    return weights / weights.sum(axis=1, keepdims=True)


def test_conditional_of_table_1() -> None:
    """0.94 / 0.97 = 0.969072 and 0.03 / 0.97 = 0.030928; from m2 only m2 was seen."""
    assert np.allclose(conditional(TABLE_1), [[0.969072, 0.030928], [0.0, 1.0]], atol=1e-6)


def test_conditional_of_a_model_never_left() -> None:
    assert np.array_equal(conditional(np.array([[0.5, 0.5], [0.0, 0.0]])), [[0.5, 0.5], [0.0, 1.0]])


def test_eq_12_with_table_1_by_hand() -> None:
    """With p(x | m1) = 0.002 and p(x | m2) = 0.02:
    from m1: 0.002 * 0.94 = 0.00188 and 0.02 * 0.03 = 0.0006, of 0.00248: 0.758065 and 0.241935;
    from m2: 0.002 * 0 = 0 and 0.02 * 0.03: 0 and 1."""
    rows, fell_back = adaptive(level_density(0.002, 0.02)).rows(boxes(2, x=50), np.array([0, 1]), 0.04)
    assert np.allclose(rows, [[0.758065, 0.241935], [0.0, 1.0]], atol=1e-6)
    assert not fell_back.any()


def test_eq_12_near_the_end_of_the_belt() -> None:
    """p(x | m1) = 0.0001 and p(x | m2) = 0.01: 0.000094 against 0.0003, so 0.238579 and 0.761421."""
    rows, _ = adaptive(level_density(0.0001, 0.01)).rows(boxes(1, x=50), np.array([0]), 0.04)
    assert np.allclose(rows, [[0.238579, 0.761421]], atol=1e-6)


def test_eq_12_degenerates_to_eq_10_where_densities_are_equal() -> None:
    states, labels = boxes(4, x=20), np.array([0, 1, 0, 1])
    rows, fell_back = adaptive(level_density(0.004, 0.004)).rows(states, labels, 0.04)
    fixed, _ = FixedSwitching(conditional(TABLE_1), 0.04, REGIMES).rows(states, labels, 0.04)
    assert np.allclose(rows, fixed, atol=1e-15)
    assert not fell_back.any()


def test_far_from_data_falls_back_on_eq_10_and_says_so() -> None:
    states = boxes(4)
    states[:, X] = [50.0, -1e4, 1e4, 50.0]
    rows, fell_back = adaptive(level_density(0.002, 0.02)).rows(states, np.array([0, 0, 1, 1]), 0.04)
    assert np.array_equal(fell_back, [False, True, True, False])
    assert np.array_equal(rows[1:3], conditional(TABLE_1))
    assert np.all(np.isfinite(rows))


def test_vanishing_density_inside_the_grid_falls_back() -> None:
    """At the right end all densities are below a millionth of their highest value."""
    density = GridDensity((X,), np.zeros(1), np.array([100.0]), np.array([[1.0, 1e-9], [1.0, 1e-12]]))
    rows, fell_back = adaptive(density).rows(boxes(1, x=100), np.array([0]), 0.04)
    assert fell_back.all()
    assert np.array_equal(rows[0], conditional(TABLE_1)[0])


def test_reachable_models_absent_falls_back() -> None:
    """From m2 only m2 can follow, which was never seen here: Eq. 12 is 0 / 0."""
    rows, fell_back = adaptive(level_density(0.01, 0.0)).rows(boxes(2, x=50), np.array([1, 0]), 0.04)
    assert np.array_equal(fell_back, [True, False])
    assert np.array_equal(rows, [[0.0, 1.0], [1.0, 0.0]])


@given(chains(), st.data())
def test_adaptive_rows_are_probabilities(matrix: Array, data: st.DataObject) -> None:
    levels = data.draw(st.lists(st.floats(0, 1), min_size=len(matrix), max_size=len(matrix)))
    switching = AdaptiveSwitching(matrix, 0.04, np.zeros(len(matrix), np.bool_), level_density(*levels))
    dt = data.draw(st.floats(1e-3, 1.0))
    rows, _ = switching.rows(boxes(len(matrix), x=30), np.arange(len(matrix)), dt)
    assert np.all(rows >= 0)
    assert np.allclose(rows.sum(axis=1), 1.0, atol=1e-9)


def test_matrix_is_applied_once() -> None:
    """From m1 with equal densities the row is that of the matrix, not of its square."""
    matrix = np.array([[0.9, 0.1], [0.3, 0.7]])
    switching = AdaptiveSwitching(matrix, 0.04, REGIMES, level_density(0.01, 0.01))
    rows, _ = switching.rows(boxes(2, x=30), np.array([0, 1]), 0.04)
    assert np.allclose(rows, matrix, atol=1e-15)
    assert not np.allclose(rows, matrix @ matrix, atol=0.05)


@given(chains(), st.integers(1, 6))
def test_whole_intervals_multiply(matrix: Array, steps: int) -> None:
    expected = np.eye(len(matrix))
    for _ in range(steps):
        expected = expected @ matrix
    regimes = np.zeros(len(matrix), np.bool_)
    assert np.allclose(over_interval(matrix, float(steps), regimes), expected, atol=1e-12)


@given(chains(), st.floats(1e-3, 12.0), st.data())
def test_any_interval_keeps_rows_probabilities(matrix: Array, steps: float, data: st.DataObject) -> None:
    models = len(matrix)
    momentary = np.array(data.draw(st.lists(st.booleans(), min_size=models, max_size=models)))
    before = matrix.copy()
    rows = over_interval(matrix, steps, momentary)
    assert np.all(rows >= 0)
    assert np.allclose(rows.sum(axis=1), 1.0, atol=1e-9)
    assert np.array_equal(rows[momentary], matrix[momentary])
    assert np.array_equal(matrix, before)


def test_half_an_interval_switches_half_as_often() -> None:
    matrix = np.array([[0.9, 0.1], [0.3, 0.7]])
    assert np.allclose(over_interval(matrix, 0.5, REGIMES), [[0.95, 0.05], [0.15, 0.85]])
    # One and a half: the matrix times the half-interval one, worked by hand.
    assert np.allclose(over_interval(matrix, 1.5, REGIMES), [[0.87, 0.13], [0.39, 0.61]])


def test_interval_is_continuous_at_one_step() -> None:
    matrix = np.array([[0.9, 0.1], [0.3, 0.7]])
    for steps in (1 - 1e-5, 1 - 1e-7, 1.0, 1 + 1e-7, 1 + 1e-5):
        assert np.allclose(over_interval(matrix, steps, REGIMES), matrix, atol=1e-5)


def test_interval_enters_the_rows() -> None:
    """Half a frame after the last: half the rate of switching, in both kinds."""
    matrix = np.array([[0.9, 0.1], [0.3, 0.7]])
    expected = [[0.95, 0.05], [0.15, 0.85]]
    states, labels = boxes(2, x=30), np.array([0, 1])
    fixed, fell_back = FixedSwitching(matrix, 0.04, REGIMES).rows(states, labels, 0.02)
    assert np.allclose(fixed, expected)
    assert not fell_back.any()
    equal = AdaptiveSwitching(matrix, 0.04, REGIMES, level_density(0.01, 0.01))
    assert np.allclose(equal.rows(states, labels, 0.02)[0], expected)


def test_joint_probabilities_are_relative_frequencies() -> None:
    """Table 1 as 100 pairs: 94 + 3 from m1 and 3 from m2, none from m2 to m1. (The paper's four numbers
    sum to 1.)"""
    previous = np.array([0] * 97 + [1] * 3)
    following = np.array([0] * 94 + [1] * 3 + [1] * 3)
    joint = joint_probabilities(previous, following, 2, pseudo_count=0)
    assert np.allclose(joint, TABLE_1, atol=1e-15)
    assert joint[1, 0] == 0.0


def test_pseudo_count_keeps_unseen_pairs_possible() -> None:
    """One pair (0, 0) and 0.1 spread over each row: 1.05, 0.05, 0.05, 0.05 of 1.2."""
    joint = joint_probabilities(np.array([0]), np.array([0]), 2)
    assert np.allclose(joint, np.array([[1.05, 0.05], [0.05, 0.05]]) / 1.2)


def test_no_pairs_are_refused() -> None:
    none = np.empty(0, np.intp)
    with pytest.raises(ValueError, match="no pairs"):
        joint_probabilities(none, none, 2, pseudo_count=0)


@pytest.mark.parametrize(
    "bad",
    [
        np.array([[0.5, 0.5]]),
        np.array([1.0]),
        np.array([[0.5, 0.4], [0.0, 1.0]]),
        np.array([[1.5, -0.5], [0.0, 1.0]]),
        np.array([[np.nan, 0.5], [0.0, 1.0]]),
    ],
)
def test_bad_matrices_are_refused(bad: Array) -> None:
    with pytest.raises(ValueError, match="transition matrix"):
        check_matrix(bad)


@given(chains())
def test_good_matrices_pass(matrix: Array) -> None:
    assert np.array_equal(check_matrix(matrix), matrix)


def test_draw_frequencies() -> None:
    """Chi-square over 100,000 draws from one row; a right draw passes its bound but for 1e-9."""
    probabilities = np.array([0.5, 0.3, 0.0, 0.2])
    n = 100_000
    labels = draw(np.tile(probabilities, (n, 1)), np.random.default_rng(7))
    counts = np.bincount(labels, minlength=4)
    assert counts[2] == 0
    possible = probabilities > 0
    expected = n * probabilities[possible]
    assert np.sum((counts[possible] - expected) ** 2 / expected) < chi2.isf(1e-9, df=2)


def test_draws_of_different_rows_are_independent() -> None:
    """Two rows of one half each, drawn together: the four pairs are equally frequent."""
    labels = draw(np.full((100_000, 2), 0.5), np.random.default_rng(8)).reshape(-1, 2)
    pairs = np.bincount(2 * labels[:, 0] + labels[:, 1], minlength=4)
    assert np.sum((pairs - 12_500) ** 2 / 12_500) < chi2.isf(1e-9, df=3)


class _Edge:
    """A generator that gives the same number for every row."""

    def __init__(self, u: float) -> None:
        self.u = u

    def random(self, n: int) -> Array:
        return np.full(n, self.u)


@given(chains(), st.sampled_from([0.0, 0.5, float(np.nextafter(1.0, 0.0))]))
def test_draw_never_takes_an_impossible_label(matrix: Array, u: float) -> None:
    """Also at the ends of the uniform number, where rounding of the cumulative sum shows."""
    labels = draw(matrix, _Edge(u))  # type: ignore[arg-type]
    assert np.all(matrix[np.arange(len(matrix)), labels] > 0)
