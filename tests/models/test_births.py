"""Newborn states: uniform over the polygon, velocity and size from the profile, labels by P_b."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.stats import chi2, kstest, norm, truncnorm

from lumpwatch.models.jdt.births import KernelBirths, polygon_births
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.state import AX, AY, VX, VY, H, W, X, Y
from tests.models.helpers import flat_profile

N = 100_000
FALSE_ALARM = 1e-9
"""Probability with which a right draw fails one test here."""
ONE = np.array([1.0])
FLAT = flat_profile((0.0, 0.0, 2.0, 2.0))


def test_uniform_over_the_pixels_of_the_mask() -> None:
    mask = np.zeros((12, 15), np.uint8)
    cv2.fillPoly(mask, [np.array([[1, 1], [13, 3], [9, 11], [2, 8]], np.int32)], 1)
    states, _ = polygon_births(mask, FLAT, ONE).draw(N, np.random.default_rng(1))
    counts = np.zeros(mask.shape)
    np.add.at(counts, (np.floor(states[:, Y]).astype(int), np.floor(states[:, X]).astype(int)), 1)
    assert counts[mask == 0].sum() == 0
    cells = counts[mask == 1]
    expected = N / len(cells)
    assert np.sum((cells - expected) ** 2 / expected) < chi2.isf(FALSE_ALARM, df=len(cells) - 1)


def test_uniform_within_a_pixel() -> None:
    mask = np.zeros((5, 5), np.uint8)
    mask[2, 3] = 1
    states, _ = polygon_births(mask, FLAT, ONE).draw(N, np.random.default_rng(2))
    assert kstest(states[:, X] - 3, "uniform").pvalue > FALSE_ALARM
    assert kstest(states[:, Y] - 2, "uniform").pvalue > FALSE_ALARM


def test_labels_by_birth_probabilities() -> None:
    probabilities = np.array([0.6, 0.0, 0.3, 0.1])
    births = polygon_births(np.ones((4, 4), np.uint8), FLAT, probabilities)
    _, labels = births.draw(N, np.random.default_rng(3))
    counts = np.bincount(labels, minlength=4)
    assert counts[1] == 0
    possible = probabilities > 0
    expected = N * probabilities[possible]
    assert np.sum((counts[possible] - expected) ** 2 / expected) < chi2.isf(FALSE_ALARM, df=2)


def test_velocity_and_size_from_the_profile_at_the_row_of_birth() -> None:
    """Means run from (1, 10, 2, 2.2) at row 0 to (1, 30, 3, 3.2) at row 100; standardised by mean and
    spread of its own row, every quantity is a standard Gaussian."""
    profile = RowProfile(
        0.0,
        100.0,
        np.array([[1, 10, 2, 2.2], [1, 30, 3, 3.2]]),
        np.array([[0.5, 2, 0.1, 0.2], [0.5, 6, 0.3, 0.2]]),
    )
    births = polygon_births(np.ones((100, 10), np.uint8), profile, ONE)
    states, _ = births.draw(N, np.random.default_rng(4))
    part = states[:, Y] / 100
    for column, value, mean, spread in (
        (VX, states[:, VX], 1.0 + 0 * part, 0.5 + 0 * part),
        (VY, states[:, VY], 10 + 20 * part, 2 + 4 * part),
        (W, np.log(states[:, W]), 2 + part, 0.1 + 0.2 * part),
        (H, np.log(states[:, H]), 2.2 + part, 0.2 + 0 * part),
    ):
        deviation = (value - mean) / spread
        if column in (W, H):  # sizes end at two standard deviations
            assert np.abs(deviation).max() == pytest.approx(2.0)
            deviation = deviation[np.abs(deviation) < 1.999]
            law = truncnorm(-1.999, 1.999)
        else:
            law = norm()
        assert kstest(deviation, law.cdf).pvalue > FALSE_ALARM, column
    assert np.all(states[:, [AX, AY]] == 0)


def test_same_seed_same_draw_and_none_is_none() -> None:
    births = polygon_births(np.ones((9, 9), np.uint8), FLAT, np.array([0.5, 0.5]))
    one, two = births.draw(50, np.random.default_rng(5)), births.draw(50, np.random.default_rng(5))
    assert np.array_equal(one[0], two[0])
    assert np.array_equal(one[1], two[1])
    states, labels = births.draw(0, np.random.default_rng(5))
    assert states.shape == (0, 8)
    assert labels.shape == (0,)


def test_empty_mask_is_refused() -> None:
    with pytest.raises(ValueError, match="no pixel"):
        polygon_births(np.zeros((5, 5), np.uint8), FLAT, ONE)


def test_learned_births_come_where_objects_came() -> None:
    """Two places, a spread of 2 and 4 px around them; a tenth of the newborn is anywhere."""
    profile = RowProfile(0.0, 100.0, np.array([[1, 10, 2, 2.2], [1, 30, 3, 3.2]]), np.full((2, 4), 1e-6))
    anywhere = polygon_births(np.ones((100, 80), np.uint8), profile, ONE)
    births = KernelBirths(np.array([[20.0, 30.0], [60.0, 50.0]]), np.array([2.0, 4.0]), anywhere)
    states, _ = births.draw(N, np.random.default_rng(5))
    first = (np.abs(states[:, :2] - [20, 30]) < [8, 16]).all(axis=1)
    second = (np.abs(states[:, :2] - [60, 50]) < [8, 16]).all(axis=1)
    # Of the uniform tenth, 16 x 32 of 80 x 100 px fall into each window: 0.45 + 0.0064.
    assert first.mean() == pytest.approx(0.4564, abs=0.01)
    assert second.mean() == pytest.approx(0.4564, abs=0.01)
    assert states[first, :2].std(axis=0) == pytest.approx([2.0, 4.0], rel=0.15)
    # Velocity and size are those of the row of birth.
    assert states[:, VY] == pytest.approx(10 + 20 * np.clip(states[:, Y] / 100, 0, 1), abs=1e-3)
    assert np.log(states[:, W]) == pytest.approx(2 + np.clip(states[:, Y] / 100, 0, 1), abs=1e-3)
