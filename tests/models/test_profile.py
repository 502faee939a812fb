"""The row profile: interpolation, learning by a kernel average over rows, and scaling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.jdt.row_profile import (
    ASPECT,
    LARGEST,
    NARROWEST,
    SIZE_LIMIT,
    SIZE_MEMORY_S,
    SMALLEST,
    RowProfile,
    along_polygon,
    around_limit,
    default_profile,
    learn_profile,
)
from lumpwatch.models.state import VX, VY, H, States, W, Y
from tests.models.helpers import boxes

LOG_10, LOG_40 = np.log(10.0), np.log(40.0)
SLOPING = RowProfile(
    20.0,
    100.0,
    np.array([[0.0, 5.0, LOG_10, LOG_10], [2.0, 25.0, LOG_40, LOG_10]]),
    np.array([[1.0, 1.0, 0.1, 0.1], [3.0, 5.0, 0.3, 0.1]]),
)
"""At row 20: 10 x 10 px at (0, 5) px/s; at row 120: 40 x 10 px at (2, 25) px/s."""


def moving(y: float, vx: float, vy: float, w: float, h: float, n: int = 1) -> States:
    states = boxes(n, 0.0, y, w, h)
    states[:, VX], states[:, VY] = vx, vy
    return states


def test_rows_between_and_beyond_the_knots() -> None:
    """A quarter of the way the mean is (0.5, 10, ...) and the width 10 * 4^(1/4); the ends hold."""
    mean, spread = SLOPING.at(np.array([20.0, 45.0, 120.0, -500.0, 900.0]))
    assert mean[1] == pytest.approx([0.5, 10.0, LOG_10 + 0.25 * np.log(4), LOG_10])
    assert spread[1] == pytest.approx([1.5, 2.0, 0.15, 0.1])
    for row, knot in ((0, 0), (2, 1), (3, 0), (4, 1)):
        assert np.array_equal(mean[row], SLOPING.mean[knot])
        assert np.array_equal(spread[row], SLOPING.spread[knot])


def test_profile_of_one_row_is_constant() -> None:
    one = RowProfile(5.0, 1.0, SLOPING.mean[:1], SLOPING.spread[:1])
    mean, spread = one.at(np.array([-3.0, 5.0, 99.0]))
    assert np.array_equal(mean, np.repeat(SLOPING.mean[:1], 3, axis=0))
    assert np.array_equal(spread, np.repeat(SLOPING.spread[:1], 3, axis=0))


def test_sizes_around_a_limit_reach_from_the_smallest_to_the_largest_of_interest() -> None:
    """A limit of 20 px at the top and 60 px at the bottom; the usual ratio of the sides stays as it was."""
    profile = around_limit(SLOPING, np.linspace(20.0, 60.0, 121))
    mean, spread = profile.at(np.array([20.0, 120.0]))
    limit = np.interp([20.0, 120.0], np.arange(121) + 0.5, np.linspace(20.0, 60.0, 121))
    side = 0.5 * (mean[:, 2] + mean[:, 3])
    assert np.exp(side - SIZE_LIMIT * spread[:, 2]) == pytest.approx(SMALLEST * limit)
    assert np.exp(side + SIZE_LIMIT * spread[:, 3]) == pytest.approx(LARGEST * limit)
    assert np.exp(mean[:, 2] - mean[:, 3]) == pytest.approx([1.0, 4.0])
    assert np.array_equal(mean[:, :2], SLOPING.mean[:, :2])
    assert profile.aspect_spread == ASPECT


def test_usual_sizes_beyond_the_limit_are_looked_for_too() -> None:
    """A limit of 4 px where lumps are 20 x 10 px, one standard deviation of the width being 0.2."""
    mean, spread = around_limit(SLOPING, np.full(200, 4.0)).at(np.array([70.0]))
    side = 0.5 * (mean[0, 2] + mean[0, 3])
    assert np.exp(side - SIZE_LIMIT * spread[0, 2]) == pytest.approx(SMALLEST * 4.0)
    largest = np.exp(side + SIZE_LIMIT * spread[0, 2])
    knots = np.array([[10.0, 10.0, 0.1], [40.0, 10.0, 0.3]])  # between the two knots logs are interpolated
    expected = np.exp(np.mean(0.5 * np.log(knots[:, 0] * knots[:, 1]) + knots[:, 2]))
    assert largest == pytest.approx(expected, rel=1e-6)


def sizes_after(profile: RowProfile, before: States, row: float, dt: float, seed: int = 0) -> States:
    after = moving(row, 3, 4, 1, 1, len(before))
    profile.follow(before, after, dt, np.random.default_rng(seed))
    return after


def test_follow_scales_the_size_by_the_expected_one() -> None:
    """From row 20 to 70 the expected width doubles (half of log 4) and the height stays: in no time, and so
    without noise, 12 x 9 px become 24 x 9."""
    before = moving(20, 0, 0, 12, 9)
    after = sizes_after(SLOPING, before, 70, 1e-12)
    assert after[0, [W, H]] == pytest.approx([24.0, 9.0], rel=1e-4)
    assert np.array_equal(after[0, :W], moving(70, 3, 4, 1, 1)[0, :W])
    assert np.array_equal(before, moving(20, 0, 0, 12, 9))


def test_follow_keeps_the_law_of_newborn_sizes() -> None:
    """Sizes drawn at row 70 have the spreads 0.2 and 0.1 there, and keep them whatever the step."""
    rng = np.random.default_rng(1)
    before = moving(70, 0, 0, 1, 1, 20_000)
    before[:, W : H + 1] = SLOPING.draw(before[:, Y], rng)[:, 2:]
    for dt in (0.05, 5.0):
        logs = np.log(sizes_after(SLOPING, before, 70, dt)[:, W : H + 1])
        # Clipping at two standard deviations leaves 0.959 of a normal deviate's spread.
        assert logs.std(axis=0) == pytest.approx([0.959 * 0.2, 0.959 * 0.1], rel=0.03)
        assert logs.mean(axis=0) == pytest.approx([np.log(20.0), np.log(10.0)], abs=0.01)


def test_follow_forgets_in_the_stated_time() -> None:
    """A width 0.3 in log above the expected one (1.5 spreads) is 0.3 / e above it after the memory time."""
    before = moving(70, 0, 0, 20 * np.exp(0.3), 10, 20_000)
    logs = np.log(sizes_after(SLOPING, before, 70, SIZE_MEMORY_S)[:, W])
    # The limit of 0.4 cuts off 5 % above and 0.2 % below: the mean loses some 0.004.
    assert logs.mean() - np.log(20.0) == pytest.approx(0.3 / np.e, abs=0.006)


def test_no_size_beyond_the_limit() -> None:
    before = moving(70, 0, 0, 90, 2, 1000)
    deviation = np.log(sizes_after(SLOPING, before, 70, 0.1)[:, W : H + 1]) - np.log([20.0, 10.0])
    assert np.abs(deviation / [0.2, 0.1]).max() <= SIZE_LIMIT + 1e-9
    drawn = np.log(SLOPING.draw(np.full(5000, 70.0), np.random.default_rng(2))[:, 2:]) - np.log([20.0, 10.0])
    assert np.abs(drawn / [0.2, 0.1]).max() == pytest.approx(SIZE_LIMIT)


@given(st.floats(20, 120), st.floats(0.05, 20))
def test_scaled(row: float, factor: float) -> None:
    """Velocities scale with the picture, log sizes shift, spreads of log sizes stay."""
    mean, spread = SLOPING.at(np.array([row]))
    large_mean, large_spread = SLOPING.scaled(factor).at(np.array([row * factor]))
    assert large_mean[0, :2] == pytest.approx(mean[0, :2] * factor, rel=1e-6, abs=1e-9)
    assert np.exp(large_mean[0, 2:]) == pytest.approx(np.exp(mean[0, 2:]) * factor, rel=1e-6)
    assert large_spread[0, :2] == pytest.approx(spread[0, :2] * factor, rel=1e-6)
    assert large_spread[0, 2:] == pytest.approx(spread[0, 2:], rel=1e-6)


def test_scaling_leaves_the_profile_alone() -> None:
    before = SLOPING.mean.copy(), SLOPING.spread.copy()
    SLOPING.scaled(3.0)
    assert np.array_equal(SLOPING.mean, before[0])
    assert np.array_equal(SLOPING.spread, before[1])


def test_default_profile_by_hand() -> None:
    """Sizes from 10 to 40 px: geometric mean 20, and exp(2 sd) = 2. Speed 30 px/s: 15 +- 15 downwards."""
    profile = default_profile(200.0, 10.0, 40.0, 30.0)
    for row in (0.0, 130.0, 200.0):
        mean, spread = profile.at(np.array([row]))
        assert mean[0, :2] == pytest.approx([0.0, 15.0])
        assert np.exp(mean[0, 2:]) == pytest.approx([20.0, 20.0])
        assert spread[0, :2] == pytest.approx([3.0, 15.0])
        assert np.exp(2 * spread[0, 2:]) == pytest.approx([2.0, 2.0])


def test_sizes_grow_with_the_width_of_the_polygon_by_hand() -> None:
    """Widths from 50 to 100 on 101 rows: three quarters of them are narrower than 87.5, where sizes are as said."""
    mask = np.zeros((101, 120), np.uint8)
    for row in range(101):
        mask[row, : 50 + row // 2] = 1
    flat = default_profile(101.0, 10.0, 40.0, 30.0)
    mean, spread = along_polygon(flat, mask).at(np.array([0.0, 75.0, 100.0]))
    assert np.exp(mean[:, 2]) == pytest.approx(20.0 * np.array([50.0, 87.5, 100.0]) / 87.5, rel=0.01)
    assert mean[:, :2] == pytest.approx(np.array([[0.0, 15.0]] * 3))
    assert spread == pytest.approx(np.repeat(flat.spread[:1], 3, axis=0))


@pytest.mark.parametrize("mask", [np.ones((80, 60), np.uint8), np.zeros((80, 60), np.uint8)])
def test_a_region_that_does_not_narrow_changes_no_size(mask: NDArray[np.uint8]) -> None:
    flat = default_profile(80.0, 10.0, 40.0, 30.0)
    rows = np.linspace(0.0, 80.0, 9)
    assert along_polygon(flat, mask).at(rows)[0] == pytest.approx(flat.at(rows)[0])


def test_the_far_end_of_a_triangle_is_not_without_size() -> None:
    mask = np.tril(np.ones((100, 100), np.uint8))
    flat = default_profile(100.0, 10.0, 40.0, 30.0)
    mean, _ = along_polygon(flat, mask).at(np.array([0.0, 99.0]))
    assert np.exp(mean[0, 2] - mean[1, 2]) == pytest.approx(NARROWEST, rel=0.02)


def kernel_average(rows: NDArray[np.float64], row: float, height: float) -> NDArray[np.float64]:
    """Weights of training rows at one row: a Gaussian whose bandwidth is a tenth of the height."""
    weights = np.array([np.exp(-0.5 * ((y - row) / (0.1 * height)) ** 2) for y in rows])
    return weights / weights.sum()


def test_learned_from_two_rows_by_hand() -> None:
    """100 rows, so a bandwidth of 10. Row 40 sees (vx, vy) = (0, 10) and 10 x 10 px, row 60 (0, 30) and
    40 x 40 px. Half way both weigh the same: mean 20 px/s, spread 10 plus the margin of a tenth of 20 and
    of 1e-3 of the height; sizes log 20 with a spread of log 2."""
    states = np.concatenate([moving(40, 0, 10, 10, 10), moving(60, 0, 30, 40, 40)])
    mean, spread = learn_profile(states, 100.0).at(np.array([50.0, 0.0, 100.0]))
    assert mean[0] == pytest.approx([0.0, 20.0, np.log(20), np.log(20)])
    assert spread[0] == pytest.approx([2.1, 12.1, np.log(2), np.log(2)])
    # At the ends the nearer row has exp(-16/2 + 36/2) = 22,026 times the weight of the other.
    share = 1 / (1 + np.exp(10.0))
    assert mean[1, 1] == pytest.approx(10 + 20 * share)
    assert mean[2, 1] == pytest.approx(30 - 20 * share)
    assert spread[1, 2:] == pytest.approx([0.1, 0.1])


def test_learned_at_its_knots_against_a_plain_average() -> None:
    rng = np.random.default_rng(3)
    states = boxes(60)
    states[:, Y] = rng.uniform(10, 150, 60)
    states[:, [VX, VY]] = rng.normal((1.0, 20.0), (2.0, 6.0), (60, 2))
    states[:, [W, H]] = np.exp(rng.normal(3.0, 0.3, (60, 2)))
    profile = learn_profile(states, 160.0)
    for row in (0.0, 70.0, 160.0):
        weights = kernel_average(states[:, Y], row, 160.0)
        values = np.column_stack([states[:, VX], states[:, VY], np.log(states[:, W]), np.log(states[:, H])])
        centre = weights @ values
        deviation = np.sqrt(weights @ (values - centre) ** 2)
        mean, spread = profile.at(np.array([row]))
        assert mean[0] == pytest.approx(centre)
        speed = np.hypot(centre[0], centre[1])
        assert spread[0, :2] == pytest.approx(deviation[:2] + 0.1 * speed + 0.16)
        assert spread[0, 2:] == pytest.approx(np.maximum(deviation[2:], 0.1))


def test_rows_far_from_all_training_take_the_nearest() -> None:
    """The kernel of rows 40 bandwidths away underflows; the average must not become 0 / 0."""
    states = moving(4000.0, 1.0, 10.0, 20.0, 20.0, n=3)
    mean, spread = learn_profile(states, 100.0).at(np.array([0.0]))
    assert mean[0] == pytest.approx([1.0, 10.0, np.log(20), np.log(20)])
    assert np.all(np.isfinite(spread))


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        learn_profile(np.empty((0, 8)), 100.0)
