"""Marginals against enumeration of all joint events, by hand, and in the limits."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from lumpwatch.models.trackers.jpda import associate, associate_star

Array = NDArray[np.float64]


def enumerated(likelihood: Array, detection: Array, clutter: float, gate: float, star: bool = False) -> Array:
    """Eq. 24 event by event: lambda^false, P_D L for a pair, 1 - P_D P_G for a miss; one permutation for JPDA*."""
    n, m = likelihood.shape
    total = np.zeros((n, m + 1))
    best: dict[object, tuple[float, tuple[int, ...]]] = {}
    for event in itertools.product(range(m + 1), repeat=n):
        used = [j for j in event if j > 0]
        if len(used) > len(set(used)):
            continue
        weight = clutter ** (m - len(used))
        for i, j in enumerate(event):
            weight *= detection[i] * likelihood[i, j - 1] if j else 1.0 - detection[i] * gate
        kind = (tuple(j > 0 for j in event), frozenset(used)) if star else event
        best[kind] = max(best.get(kind, (-1.0, event)), (weight, event))
    for weight, event in best.values():
        for i, j in enumerate(event):
            total[i, j] += weight
    return total / total.sum(axis=1, keepdims=True)


@st.composite
def situations(draw: st.DrawFn) -> tuple[Array, Array, float, float]:
    n, m = draw(st.integers(1, 4)), draw(st.integers(0, 5))
    density = st.one_of(st.just(0.0), st.floats(1e-6, 1e3))
    return (
        draw(arrays(float, (n, m), elements=density)),
        draw(arrays(float, n, elements=st.floats(0.0, 0.999))),
        draw(st.floats(1e-5, 10.0)),
        draw(st.floats(0.5, 1.0)),
    )


@settings(max_examples=300, deadline=None)
@given(situations())
def test_marginals_equal_enumeration(case: tuple[Array, Array, float, float]) -> None:
    likelihood, detection, clutter, gate = case
    result = associate(likelihood, detection, clutter, gate)
    assert result.beta == pytest.approx(enumerated(likelihood, detection, clutter, gate), abs=1e-12)
    assert not result.approximate.any()


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 4), st.integers(0, 5), st.integers(0, 2**32 - 1), st.floats(0.0, 0.999))
def test_pruned_marginals_equal_enumeration(n: int, m: int, seed: int, detection: float) -> None:
    """Drawn at random: of equally likely permutations either may be kept."""
    rng = np.random.default_rng(seed)
    likelihood = rng.exponential(1.0, (n, m)) * (rng.random((n, m)) < 0.7)
    result = associate_star(likelihood, detection, 0.3, 0.9)
    expected = enumerated(likelihood, np.full(n, detection), 0.3, 0.9, star=True)
    assert result.beta == pytest.approx(expected, abs=1e-12)
    assert not result.approximate.any()


def test_pruned_by_hand() -> None:
    """r = [[2, 1], [1, 3]]: 1 (none), 2 + 1 + 1 + 3 (one pair) and 6 (both, straight), 1 (crossed) left out: 14."""
    beta = associate_star(np.array([[0.2, 0.1], [0.1, 0.3]]), 0.5, 0.1).beta
    assert beta == pytest.approx(np.array([[5, 8, 1], [4, 1, 9]]) / 14, abs=1e-14)


def test_too_large_a_cluster_is_not_pruned_and_says_so() -> None:
    likelihood = np.random.default_rng(0).exponential(1.0, (7, 10))
    result = associate_star(likelihood, 0.9, 0.1)
    assert result.approximate.all()
    assert result.beta == pytest.approx(associate(likelihood, 0.9, 0.1).beta, abs=1e-14)


@settings(max_examples=100, deadline=None)
@given(st.integers(1, 12), st.integers(0, 20), st.integers(0, 2**32 - 1), st.sampled_from([0.5, 0.9, 1.0]))
def test_probabilities_sum(n: int, m: int, seed: int, detection: float) -> None:
    """Also where the densities span 80 orders of magnitude and where detection is certain."""
    rng = np.random.default_rng(seed)
    likelihood = 10.0 ** rng.uniform(-40.0, 40.0, (n, m)) * (rng.random((n, m)) < 0.5)
    beta = associate(likelihood, detection, 1e-4).beta
    assert np.all(np.isfinite(beta))
    assert np.all(beta >= 0.0)
    assert beta.sum(axis=1) == pytest.approx(np.ones(n), abs=1e-9)
    assert np.all(beta[:, 1:].sum(axis=0) <= 1.0 + 1e-9)


def test_two_targets_by_hand() -> None:
    """Both gate the first measurement, the second target alone gates the other one.

    With P_D = 1/2 the ratios are r = L / lambda: r_11 = 2, r_21 = 1, r_22 = 3. The matchings weigh
    1 (none), 2 (1-1), 1 (2-1), 3 (2-2) and 6 (1-1 and 2-2): 13 in all.
    """
    beta = associate(np.array([[0.2, 0.0], [0.1, 0.3]]), 0.5, 0.1).beta
    assert beta == pytest.approx(np.array([[5, 8, 0], [3, 1, 9]]) / 13, abs=1e-14)


def test_gate_probability_raises_the_miss() -> None:
    """One target, one measurement: odds P_D L / (lambda (1 - P_D P_G)) = 0.4 / (1 - 0.4) = 2 to 3."""
    beta = associate(np.array([[1.0]]), 0.5, 1.25, gate_probability=0.8).beta
    assert beta == pytest.approx(np.array([[0.6, 0.4]]), abs=1e-14)


def test_clusters_do_not_see_one_another() -> None:
    """Two far pairs together give what each gives alone."""
    rng = np.random.default_rng(0)
    one, two = rng.random((3, 4)), rng.random((2, 3))
    both = np.zeros((5, 7))
    both[:3, :4], both[3:, 4:] = one, two
    beta = associate(both, 0.8, 0.3).beta
    alone = associate(one, 0.8, 0.3).beta, associate(two, 0.8, 0.3).beta
    assert beta[:3, :5] == pytest.approx(alone[0], abs=1e-14)
    assert beta[3:, [0, 5, 6, 7]] == pytest.approx(alone[1], abs=1e-14)


def test_many_targets_with_few_measurements_are_exact() -> None:
    """The sum goes over subsets of the smaller side: 40 equal targets at one measurement.

    Each pair has r = P_D / (1 - P_D) * L / lambda = 1, so 41 events weigh the same.
    """
    result = associate(np.ones((40, 1)), 0.5, 1.0)
    assert not result.approximate.any()
    assert result.beta[:, 1] == pytest.approx(np.full(40, 1 / 41), abs=1e-14)


def test_certain_detection_is_the_limit() -> None:
    """Two targets that must both be seen, and two measurements: weights L11 L22 and L12 L21."""
    beta = associate(np.array([[1e-3, 2e-3], [5e-3, 1e-2]]), 1.0, 1e-6).beta
    assert beta == pytest.approx(np.array([[0, 0.5, 0.5], [0, 0.5, 0.5]]), abs=1e-12)


def test_certain_detection_with_too_few_measurements() -> None:
    """One measurement for two: it goes to either by its likelihood, and the other is missed."""
    beta = associate(np.array([[3.0], [1.0]]), np.array([1.0, 1.0]), 1.0).beta
    assert beta.sum(axis=1) == pytest.approx([1.0, 1.0])
    assert beta[:, 1].sum() == pytest.approx(1.0)


def test_nothing_to_associate() -> None:
    assert associate(np.zeros((0, 3)), 0.9, 1.0).beta.shape == (0, 4)
    assert associate(np.zeros((2, 0)), 0.9, 1.0).beta.tolist() == [[1.0], [1.0]]
    assert associate(np.zeros((1, 2)), 0.9, 1.0).beta.tolist() == [[1.0, 0.0, 0.0]]
    assert associate(np.ones((1, 2)), 0.0, 1.0).beta.tolist() == [[1.0, 0.0, 0.0]]


def test_large_cluster_falls_back_and_is_flagged() -> None:
    """Belief propagation stays near the exact marginals where both can be had; a small cluster is exact."""
    rng = np.random.default_rng(5)
    likelihood = np.zeros((12, 17))
    likelihood[:10, :14] = rng.exponential(1e-3, (10, 14)) * (rng.random((10, 14)) < 0.4)
    likelihood[10:, 14:] = rng.exponential(1e-3, (2, 3))
    exact = associate(likelihood, 0.9, 1e-3)
    rough = associate(likelihood, 0.9, 1e-3, exact=5)
    assert not exact.approximate.any()
    assert rough.approximate.tolist() == [True] * 10 + [False] * 2
    assert rough.beta[10:] == pytest.approx(exact.beta[10:], abs=1e-14)
    difference = np.abs(rough.beta - exact.beta).max()
    assert 1e-6 < difference < 0.05  # near, and not by chance the same computation


def test_belief_propagation_is_exact_on_a_tree() -> None:
    """A chain of targets that each share one measurement with the next has no cycle."""
    likelihood = np.zeros((6, 7))
    for i in range(6):
        likelihood[i, i : i + 2] = 0.3 + 0.1 * i, 0.9 - 0.1 * i
    exact, rough = (associate(likelihood, 0.8, 0.5, exact=k) for k in (12, 0))
    assert rough.approximate.all()
    assert rough.beta == pytest.approx(exact.beta, abs=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"likelihood": np.ones(3)}, "targets, measurements"),
        ({"likelihood": np.array([[np.nan, 1.0]])}, "finite"),
        ({"likelihood": np.array([[-1.0, 1.0]])}, "negative"),
        ({"detection": np.array([0.5, 0.5])}, "1 targets do not fit"),
        ({"detection": 1.1}, "between 0 and 1"),
        ({"detection": -0.1}, "between 0 and 1"),
        ({"detection": float("nan")}, "between 0 and 1"),
        ({"gate_probability": 0.0}, "between 0 and 1"),
        ({"clutter": 0.0}, "density of clutter"),
        ({"clutter": -1.0}, "density of clutter"),
        ({"clutter": float("inf")}, "density of clutter"),
        ({"exact": 15}, "up to 14"),
    ],
)
def test_bad_input_is_refused(changed: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"likelihood": np.ones((1, 2)), "detection": 0.9, "clutter": 1.0}
    with pytest.raises(ValueError, match=message):
        associate(**(arguments | changed))  # type: ignore[arg-type]
