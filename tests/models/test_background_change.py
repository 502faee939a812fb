"""Least median of squares against its definition, and what the limits make of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.trackers.background.change import change_limits, count_differences, lmeds


def histogram(values: NDArray[np.int64]) -> NDArray[np.int32]:
    return np.bincount(values + 255, minlength=511).astype(np.int32)


@given(st.lists(st.integers(-255, 255), min_size=2, max_size=40))
def test_location_and_scale_by_brute_force(values: list[int]) -> None:
    """The shortest interval that holds more than half of the values, among all that start at one."""
    ordered = np.sort(values)
    half = len(ordered) // 2 + 1
    lengths = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
    middles = (ordered[half - 1 :] + ordered[: len(ordered) - half + 1]) / 2
    location, sigma = lmeds(histogram(np.array(values)))
    assert sigma == pytest.approx(1.4826 * (1 + 5 / (len(values) - 1)) * lengths.min() / 2)
    assert abs(location) == np.abs(middles[lengths == lengths.min()]).min()
    assert location in middles[lengths == lengths.min()]


def test_noise_is_measured_beside_a_large_object() -> None:
    """Normal noise of 6, shifted by 4, with two fifths of the pixels far off."""
    rng = np.random.default_rng(1)
    values = np.round(rng.normal(4.0, 6.0, 20_000)).astype(int)
    values[:8000] = 120
    location, sigma = lmeds(histogram(values))
    assert location == pytest.approx(4.0, abs=2.0)
    # Half of all is 5/6 of the noise: 1.38 standard deviations to each side, where 0.67 are meant.
    assert 6.0 < sigma < 1.4826 * 1.38 * 6.0 + 1.0


def test_limits_are_bounded() -> None:
    counts = np.zeros((2, 511), np.int32)
    counts[0, 255 + 30] = 100  # everything 30 brighter, no noise
    counts[1, 100:400] = 1  # spread over everything
    assert change_limits(counts, 3.0, 10.0, 40.0, 60.0)[0] == pytest.approx([20.0, 40.0])
    assert change_limits(counts, 3.0, 10.0, 40.0, 20.0)[0] == pytest.approx([-10.0, 10.0])
    low, high = change_limits(counts, 3.0, 10.0, 40.0, 60.0)[1]
    assert high - low == pytest.approx(80.0)


def test_nothing_watched_gives_the_least_limits() -> None:
    assert change_limits(np.zeros((3, 511), np.int32), 3.0, 10.0, 40.0, 60.0) == pytest.approx(
        np.array([[-10.0, 10.0]] * 3)
    )


def test_differences_are_counted_where_watched() -> None:
    picture = np.full((6, 8, 3), 100, np.uint8)
    background = np.full((6, 8, 3), 90.0, np.float32)
    background[..., 2] = 100.4
    previous = np.full((6, 8, 3), 255, np.uint8)
    watched = np.ones((6, 8), np.uint8)
    watched[:, :3] = 0
    counts = count_differences(picture, background, previous, watched)
    assert counts[0, :, 255 + 10].tolist() == [30, 30, 0]
    assert counts[0, 2, 255] == 30
    assert (counts[1, :, 255 - 155] == 30).all()
    assert counts.sum() == 2 * 3 * 30
