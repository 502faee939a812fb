from __future__ import annotations

import cv2
import numpy as np
import pytest

from lumpwatch.models.jdt.motion_prior import (
    LEAST_SAMPLES,
    VELOCITY_BINS,
    MotionPrior,
    flow_vectors,
    learn_cells,
)
from lumpwatch.models.state import VX, VY, X, Y, blank

SHAPE = (60, 90)  # two rows of three cells


def two_ways() -> MotionPrior:
    """The left upper cell moves to the right at 20 px/s, the one beside it down at 10; the rest is unknown."""
    positions = np.array([[10.0, 10.0]] * 100 + [[40.0, 10.0]] * 100)
    velocities = np.array([[20.0, 0.0]] * 100 + [[0.0, 10.0]] * 100)
    return MotionPrior("prior", learn_cells(positions, velocities, SHAPE), velocity_noise=5.0)


def at(x: float, y: float, n: int = 2000, vx: float = 0.0, vy: float = 0.0):  # type: ignore[no-untyped-def]
    states = blank(n)
    states[:, [X, Y, VX, VY]] = x, y, vx, vy
    return states


def test_velocities_come_from_the_cell() -> None:
    """Within half a bin: the grid has 15 bins from -20 to 20."""
    prior = two_ways()
    half_bin = 20.0 / VELOCITY_BINS
    for x, velocity in ((10.0, (20.0, 0.0)), (40.0, (0.0, 10.0))):
        moved = prior.move(at(x, 10.0), 0.5, np.random.default_rng(0))
        assert np.abs(moved[:, [VX, VY]] - velocity).max() <= 2 * half_bin + 1e-9
        assert np.abs(moved[:, [VX, VY]].mean(axis=0) - velocity).max() <= half_bin + 0.1
        assert moved[:, [X, Y]] == pytest.approx(np.array([x, 10.0]) + 0.5 * moved[:, [VX, VY]])


def test_a_cell_without_data_falls_back_on_the_own_velocity() -> None:
    prior = two_ways()
    states = at(80.0, 50.0, vx=7.0, vy=-3.0)
    assert not prior.cells.known(states).any()
    assert prior.cells.known(at(10.0, 10.0)).all()
    moved = prior.move(states, 0.25, np.random.default_rng(1))
    # 5 px/s in a second are 2.5 px/s in a quarter of one; the mean of 2000 is within 0.06.
    assert moved[:, [VX, VY]].mean(axis=0) == pytest.approx([7.0, -3.0], abs=0.25)
    assert moved[:, [VX, VY]].std(axis=0) == pytest.approx([2.5, 2.5], rel=0.1)


def test_too_few_vectors_are_no_data() -> None:
    cells = learn_cells(np.full((LEAST_SAMPLES - 1, 2), 10.0), np.ones((LEAST_SAMPLES - 1, 2)), SHAPE)
    assert not cells.known(at(10.0, 10.0, 1)).any()


def test_mixtures_keep_their_shares() -> None:
    """A quarter of the vectors goes left, three quarters go right."""
    velocities = np.array([[-20.0, 0.0]] * 25 + [[20.0, 0.0]] * 75)
    prior = MotionPrior("prior", learn_cells(np.full((100, 2), 10.0), velocities, SHAPE), 1.0)
    moved = prior.move(at(10.0, 10.0, 20_000), 0.1, np.random.default_rng(2))
    assert np.mean(moved[:, VX] < 0) == pytest.approx(0.25, abs=0.02)


def test_scaled() -> None:
    prior = two_ways()
    double = MotionPrior("prior", prior.cells.scaled(2.0), 10.0)
    small = prior.move(at(40.0, 10.0), 0.5, np.random.default_rng(3))
    large = double.move(at(80.0, 20.0), 0.5, np.random.default_rng(3))
    assert large == pytest.approx(2.0 * small)


def test_flow_of_a_shifted_picture() -> None:
    """Shifted by (3, -2) px in a tenth of a second: 30 px/s to the right and 20 upwards."""
    rng = np.random.default_rng(4)
    noise = rng.integers(0, 256, (120, 160)).astype(np.uint8)
    picture = cv2.GaussianBlur(noise, (0, 0), 1.5).astype(np.uint8)
    shifted = np.roll(picture, (-2, 3), axis=(0, 1))
    positions, velocities = flow_vectors(picture, shifted, 0.1)
    inner = (np.abs(positions - [80, 60]) < [60, 40]).all(axis=1)
    assert inner.sum() > 30
    assert np.median(velocities[inner], axis=0) == pytest.approx([30.0, -20.0], abs=1.0)


def test_nothing_to_follow_and_nothing_to_learn() -> None:
    flat = np.zeros((60, 80), np.uint8)
    positions, velocities = flow_vectors(flat, flat, 0.1)
    assert len(positions) == len(velocities) == 0
    with pytest.raises(ValueError, match="optical flow"):
        learn_cells(positions, velocities, SHAPE)
