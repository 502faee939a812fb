"""The compiled paths against what a user would write plainly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import (
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    FreeAcceleration,
    MotionModel,
    RandomWalk,
    move_by_label,
)
from lumpwatch.models.likelihood.histogram import BINS, HistogramLikelihood, histogram
from lumpwatch.models.state import AX, AY, VX, VY, H, States, W, X, Y
from tests.models.filters import DT, belief_of, make_filter
from tests.models.helpers import Marker, box, flat, whole_picture

Array = NDArray[np.float64]
N = 200_000


@dataclass(frozen=True)
class PlainVelocity:
    """Constant velocity written as a user would, without a law: the protocol alone."""

    name: str
    velocity_noise: float
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        moved = states.copy()
        factor = np.linalg.cholesky(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]))
        kick = self.velocity_noise * rng.standard_normal((len(states), 2, 2)) @ factor.T
        moved[:, [X, Y]] += states[:, [VX, VY]] * dt + kick[:, :, 0]
        moved[:, [VX, VY]] += kick[:, :, 1]
        moved[:, [AX, AY]] = 0.0
        return moved


def random_states(n: int, seed: int = 0) -> States:
    states = np.random.default_rng(seed).normal(20.0, 5.0, (n, 8))
    states[:, [AX, AY]] -= 20.0
    return states


def test_a_users_model_has_the_law_of_the_built_in_one() -> None:
    """Means and covariances of the change agree within six standard errors of their difference."""
    start = np.tile([40.0, 30.0, 5.0, -7.0, 2.0, 3.0, 11.0, 13.0], (N, 1))
    models: tuple[MotionModel, ...] = (ConstantVelocity("built in", 4.0), PlainVelocity("plain", 4.0))
    labels = np.arange(N) % 2
    moved = move_by_label(models, start, labels, 0.3, np.random.default_rng(1))
    ours, plain = moved[labels == 0], moved[labels == 1]
    variance = ours.var(axis=0)
    assert np.all(np.abs(ours.mean(axis=0) - plain.mean(axis=0)) <= 6 * np.sqrt(4 * variance / N) + 1e-9)
    one, other = np.cov(ours.T), np.cov(plain.T)
    error = np.sqrt(4 * (np.outer(variance, variance) + one**2) / N)
    assert np.all(np.abs(one - other) <= 6 * error + 1e-9)


def test_each_state_is_moved_by_the_model_of_its_label() -> None:
    """Without noise the result is what each model's own `move` gives; one of them has no law."""
    models: tuple[MotionModel, ...] = (
        ConstantPosition("stand", 0.0),
        Marker("mark", -1.0),
        ConstantAcceleration("fall", (3.0, 90.0), 0.0),
        RandomWalk("walk", 0.0),
        FreeAcceleration("free", 0.0),
        Bounce("wall", 0.0, along_x=True, along_y=False),
    )
    states, rng = random_states(600), np.random.default_rng(2)
    labels = rng.integers(len(models), size=len(states))
    moved = move_by_label(models, states, labels, 0.2, rng)
    for m, model in enumerate(models):
        assert np.array_equal(moved[labels == m], model.move(states[labels == m], 0.2, rng))
    assert np.array_equal(moved[:, [W, H]], states[:, [W, H]])
    assert np.array_equal(states, random_states(600))


def test_filter_gives_both_kinds_the_same_law() -> None:
    """One step of the whole filter from the same belief: position and velocity spread alike."""
    spreads = []
    for model in (ConstantVelocity("built in", 30.0), PlainVelocity("plain", 30.0)):
        jdt = make_filter(models=(model,), particles=40_000)
        belief = belief_of(jdt, 1.0)
        states = jdt.step(belief, flat(0.0), DT, np.random.default_rng(3)).belief.states
        spreads.append(states[:, [X, Y, VX, VY]].std(axis=0))
    # 28,000 particles: the standard error of a standard deviation is 0.42 %, of the ratio 0.6 %.
    assert spreads[0] / spreads[1] == pytest.approx(np.ones(4), abs=0.036)


@pytest.mark.parametrize("edges", [(0, 0, 320, 300), (0, 0, 256, 256), (0, 1, 256, 256), (7, 3, 312, 290)])
@pytest.mark.parametrize("levels", [1, 256])
def test_histogram_of_boxes_of_more_than_65535_pixels(edges: tuple[int, int, int, int], levels: int) -> None:
    """The sixteen-bit counts wrap; strips keep the sum exact, also where one bin holds everything."""
    gray = np.random.default_rng(4).integers(0, levels, (300, 320)).astype(np.uint8)
    seen = HistogramLikelihood(np.eye(BINS)[0], 0.0, 1.0, 1.0, np.inf).observe(whole_picture(gray).view(gray))
    x0, y0, x1, y1 = edges
    counted = np.bincount(gray[y0:y1, x0:x1].ravel() >> 4, minlength=BINS)
    expected = counted / counted.sum()
    assert histogram(seen.integral, box(*edges)[0]) == pytest.approx(expected, abs=1e-12)
    assert seen.distance(box(*edges))[0] == pytest.approx(1 - np.sqrt(expected[0]), abs=1e-12)
