"""Kernel densities (Eq. 14) on a grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import gaussian_kde

from lumpwatch.models.jdt.density import (
    COMPONENTS,
    GridDensity,
    bandwidth_of,
    kernel_sum,
    learn,
    leave_one_out,
    scott,
)
from lumpwatch.models.state import SIZE, VY, States, X, Y
from tests.models.helpers import level_density

Array = NDArray[np.float64]


def at_columns(columns: tuple[int, ...], values: Array) -> States:
    """States (n, 8) with the values (n, d) in the columns."""
    states = np.zeros((len(values), SIZE))
    states[:, list(columns)] = values
    return states


def integral(density: GridDensity) -> Array:
    """Trapezoidal integral of each model's density."""
    total = density.values
    for step in density.step[::-1]:
        total = np.trapezoid(total, dx=step, axis=-1)
    return total


def test_kernel_sum_by_hand() -> None:
    """One sample at 0 of bandwidth 2: the peak is 1 / (2 sqrt(2 pi)) = 0.199471, at 2 times exp(-1/2).
    Two samples halve each; in two dimensions the norms multiply."""
    one = kernel_sum(np.array([[0.0], [2.0]]), np.array([[0.0]]), np.array([2.0]))
    assert one == pytest.approx([0.1994711, 0.1209854], abs=1e-7)
    two = kernel_sum(np.array([[0.0]]), np.array([[0.0], [1e6]]), np.array([2.0]))
    assert two == pytest.approx([0.0997356], abs=1e-7)
    plane = kernel_sum(np.array([[0.0, 0.0]]), np.array([[0.0, 0.0]]), np.array([2.0, 0.5]))
    assert plane == pytest.approx([1 / (2 * np.pi)], rel=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 2), st.integers(1, 30), st.integers(0, 2**32))
def test_kernel_sum_against_brute_force(d: int, n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples, width = rng.normal(size=(n, d)), rng.uniform(0.3, 2.0, d)
    at = rng.normal(size=(1500, d))  # more points than one block of the implementation
    brute = np.zeros(len(at))
    for sample in samples:
        kernel = np.ones(len(at))
        for k in range(d):
            kernel *= np.exp(-((at[:, k] - sample[k]) ** 2) / (2 * width[k] ** 2))
            kernel /= width[k] * np.sqrt(2 * np.pi)
        brute += kernel / n
    assert np.allclose(kernel_sum(at, samples, width), brute, rtol=1e-10)


def test_scott_and_scipy_agree_in_one_dimension() -> None:
    rng = np.random.default_rng(0)
    samples = rng.gamma(2.0, 20.0, (80, 1))
    at = np.linspace(-20, 200, 300)
    reference = gaussian_kde(samples[:, 0], bw_method="scott")(at)
    assert np.allclose(kernel_sum(at[:, None], samples, scott(samples)), reference, rtol=1e-9)


def test_scott_and_scipy_agree_for_uncorrelated_components() -> None:
    """SciPy's kernel has the shape of the whole covariance; on a lattice that is diagonal."""
    samples = np.array([[x, y] for x in (0.0, 3.0, 7.0, 8.0) for y in (0.0, 10.0, 50.0)])
    at = np.random.default_rng(0).uniform(-5, 55, (200, 2))
    reference = gaussian_kde(samples.T, bw_method="scott")(at.T)
    assert np.allclose(kernel_sum(at, samples, scott(samples)), reference, rtol=1e-9)


def test_scott_by_hand() -> None:
    """0, 2 and 4: standard deviation 2, so 2 * 3^(-1/5) = 1.6055; a single sample has no spread."""
    assert scott(np.array([[0.0], [2.0], [4.0]])) == pytest.approx([2 * 3**-0.2])
    assert scott(np.array([[5.0]])) == pytest.approx([0.0])


LEAST = 4.0


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 40), st.integers(0, 2**32))
def test_interpolation_error_in_one_dimension(n: int, seed: int) -> None:
    """Below 0.5 % of the kernel's peak; the kernel is at least as wide as the least bandwidth."""
    rng = np.random.default_rng(seed)
    samples = rng.uniform(0, 300, (n, 1))
    density = learn(at_columns((Y,), samples), np.zeros(n, np.intp), 1, (Y,), LEAST)
    width = np.maximum(scott(samples), LEAST)
    at = rng.uniform(samples.min() - 5 * width[0], samples.max() + 5 * width[0], (4000, 1))
    error = np.abs(density.at(at_columns((Y,), at))[:, 0] - kernel_sum(at, samples, width))
    assert error.max() < 0.005 / (width[0] * np.sqrt(2 * np.pi))


@settings(max_examples=10, deadline=None)
@given(st.integers(2, 30), st.integers(0, 2**32))
def test_interpolation_error_in_two_dimensions(n: int, seed: int) -> None:
    """Below 1 % of the kernel's peak, while the grid can hold knots a fifth of the bandwidth apart."""
    rng = np.random.default_rng(seed)
    samples = rng.uniform(0, 20 * LEAST, (n, 2))
    density = learn(at_columns((X, Y), samples), np.zeros(n, np.intp), 1, (X, Y), LEAST)
    width = np.maximum(scott(samples), LEAST)
    assert np.all(density.step <= width / 5 + 1e-12)
    at = rng.uniform(samples.min(axis=0) - 4 * width, samples.max(axis=0) + 4 * width, (4000, 2))
    error = np.abs(density.at(at_columns((X, Y), at))[:, 0] - kernel_sum(at, samples, width))
    assert error.max() < 0.01 / (np.prod(width) * 2 * np.pi)


def test_interpolation_error_of_a_coarse_grid() -> None:
    """Spots far apart against the bandwidth: the grid is at its limit, and the error bound follows the
    distance of its knots, h^2/8 max|p''| along each axis, with max|p''| = peak / bandwidth^2."""
    samples = np.array([[0.0, 0.0], [400.0, 300.0]])
    states = at_columns((X, Y), samples)
    density = learn(states, np.array([0, 1]), 2, (X, Y), LEAST)
    assert density.step[0] > LEAST / 5
    at = np.random.default_rng(0).normal(0.0, 2 * LEAST, (5000, 2))
    exact = kernel_sum(at, samples[:1], np.full(2, LEAST))
    error = np.abs(density.at(at_columns((X, Y), at))[:, 0] - exact)
    peak = 1 / (LEAST**2 * 2 * np.pi)
    assert error.max() <= peak / LEAST**2 * np.sum(density.step**2) / 8


@pytest.mark.parametrize("components", list(COMPONENTS.values()), ids=list(COMPONENTS))
@pytest.mark.parametrize("factor", [1.0, 0.25, 3.0])
def test_densities_integrate_to_one(components: tuple[int, ...], factor: float) -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(50, 15, (60, len(components)))
    density = learn(at_columns(components, values), rng.integers(0, 3, 60), 3, components, 1.0)
    assert integral(density.scaled(factor)) == pytest.approx([1.0, 1.0, 1.0], abs=2e-3)


def test_scaled_density_is_the_density_of_the_scaled_place() -> None:
    """In a picture of half the size, areas are a quarter and densities over the plane four times."""
    rng = np.random.default_rng(5)
    places = rng.normal(50, 15, (40, 2))
    density = learn(at_columns((X, Y), places), np.zeros(40, np.intp), 1, (X, Y), 1.0)
    half = density.scaled(0.5)
    at = at_columns((X, Y), rng.normal(50, 15, (200, 2)))
    assert np.allclose(half.at(at * 0.5), 4 * density.at(at), rtol=1e-9, atol=1e-15)


def test_zero_outside_the_grid_and_for_states_that_are_no_number() -> None:
    line = learn(at_columns((VY,), np.array([[10.0], [12.0]])), np.zeros(2, np.intp), 1, (VY,), 1.0)
    far = at_columns((VY,), np.array([[-1e6], [1e6], [np.nan], [np.inf]]))
    assert np.array_equal(line.at(far), np.zeros((4, 1)))
    plane = learn(at_columns((X, Y), np.array([[10.0, 10.0]])), np.zeros(1, np.intp), 1, (X, Y), 1.0)
    far = at_columns((X, Y), np.array([[10.0, 1e6], [-1e6, 10.0], [np.nan, 10.0], [10.0, np.nan]]))
    assert np.array_equal(plane.at(far), np.zeros((4, 1)))
    near = at_columns((X, Y), np.array([[10.0, 10.0]]))
    assert plane.at(near)[0, 0] == pytest.approx(1 / (2 * np.pi), rel=0.01)


def test_ends_of_the_grid_belong_to_it() -> None:
    density = level_density(0.01, 0.03)
    ends = at_columns((X,), np.array([[0.0], [100.0], [np.nextafter(100.0, 101.0)]]))
    assert np.array_equal(density.at(ends), [[0.01, 0.03], [0.01, 0.03], [0.0, 0.0]])


def test_model_without_samples_is_zero() -> None:
    states = at_columns((Y,), np.array([[10.0], [30.0]]))
    density = learn(states, np.array([0, 2]), 4, (Y,), 2.0)
    seen = density.at(at_columns((Y,), np.array([[10.0], [30.0]])))
    assert np.array_equal(seen[:, [1, 3]], np.zeros((2, 2)))
    assert seen[0, 0] == pytest.approx(1 / (2 * np.sqrt(2 * np.pi)), rel=0.005)
    assert seen[1, 2] == pytest.approx(1 / (2 * np.sqrt(2 * np.pi)), rel=0.005)


def test_errors() -> None:
    with pytest.raises(ValueError, match="at least one"):
        learn(np.empty((0, SIZE)), np.empty(0, np.intp), 2, (Y,), 1.0)
    for least in (0.0, -1.0):
        with pytest.raises(ValueError, match="least_bandwidth"):
            learn(np.zeros((3, SIZE)), np.zeros(3, np.intp), 2, (Y,), least)


def test_bandwidth_rules_by_hand() -> None:
    """Four samples with standard deviation 2: Scott 2 * 4^(-1/5), Silverman (4/3)^(1/5) times that."""
    samples = np.array([[-np.sqrt(3.0)], [-np.sqrt(3.0)], [np.sqrt(3.0)], [np.sqrt(3.0)]])
    by_scott = 2.0 * 4 ** (-0.2)
    assert bandwidth_of(samples, "scott", 0.01) == pytest.approx([by_scott])
    assert bandwidth_of(samples, "silverman", 0.01) == pytest.approx([by_scott * (4 / 3) ** 0.2])
    assert bandwidth_of(samples, "silverman", 9.0) == pytest.approx([9.0])


def test_leave_one_out_against_brute_force() -> None:
    samples = np.random.default_rng(0).normal(size=(20, 2)) * [1.0, 3.0]
    width = np.array([0.5, 1.0])
    others = [kernel_sum(samples[i : i + 1], np.delete(samples, i, axis=0), width)[0] for i in range(20)]
    assert leave_one_out(samples, width) == pytest.approx(np.mean(np.log(others)))


def test_likelihood_narrows_the_kernels_of_two_far_clusters() -> None:
    """Two clusters of spread 1, 100 apart: Scott's rule sees one wide cloud, the likelihood does not."""
    rng = np.random.default_rng(1)
    samples = np.concatenate([rng.normal(0, 1, (50, 1)), rng.normal(100, 1, (50, 1))])
    assert bandwidth_of(samples, "scott", 0.01)[0] > 15
    assert bandwidth_of(samples, "likelihood", 0.01)[0] < 3
