"""The weighted Kalman update against the textbook, against sampling of its mixture, and its laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import (
    AffineModel,
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    FreeAcceleration,
    RandomWalk,
)
from lumpwatch.models.state import blank
from lumpwatch.models.trackers.jpda import associate
from lumpwatch.models.trackers.jpda.kalman import Gaussians, innovations, predict, transition, update

Array = NDArray[np.float64]
MODELS: tuple[AffineModel, ...] = (
    ConstantPosition("stand", 3.0),
    RandomWalk("walk", 3.0),
    ConstantVelocity("straight", 4.0),
    ConstantAcceleration("fall", (1.0, -20.0), 4.0),
    FreeAcceleration("free", 30.0),
    Bounce("bounce", 2.0, along_x=True, along_y=False),
)
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
NOISE = np.diag([2.0, 2.0])


def random_states(n: int, seed: int) -> Gaussians:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, 6, 6))
    return Gaussians(rng.normal(0.0, 10.0, (n, 6)), root @ root.transpose(0, 2, 1))


def test_constant_velocity_by_hand() -> None:
    """White-noise acceleration over dt: Q = q^2 [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]] on each axis."""
    f, u, q = transition(ConstantVelocity("straight", 3.0), 0.5)
    assert f[[0, 1], [2, 3]].tolist() == [0.5, 0.5]
    assert u.tolist() == [0.0] * 6
    axis = 9.0 * np.array([[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]])
    assert q[np.ix_([0, 2], [0, 2])] == pytest.approx(axis)
    assert q[np.ix_([1, 3], [1, 3])] == pytest.approx(axis)
    assert not q[np.ix_([0, 2, 4], [1, 3, 5])].any()


@every_model
def test_prediction_has_the_moments_of_the_particles_law(model: AffineModel) -> None:
    """40,000 particles of one state: standard errors are under 1 % of the spread, bounds are 4 %."""
    states = blank(40_000)
    states[:, :6] = 5.0, -3.0, 20.0, 8.0, 2.0, -1.0
    moved = model.move(states, 0.4, np.random.default_rng(1))[:, :6]
    after = predict(Gaussians(states[:1, :6], np.zeros((1, 6, 6))), model, 0.4)
    spread = np.sqrt(np.diag(after.covariance[0]))
    assert np.all(np.abs(moved.mean(axis=0) - after.mean[0]) <= 0.04 * spread + 1e-9)
    scale = np.outer(spread, spread)
    assert np.all(np.abs(np.cov(moved.T) - after.covariance[0]) <= 0.04 * scale + 1e-9)


@pytest.mark.parametrize("model", MODELS[:-1], ids=lambda model: model.name)
def test_two_half_steps_are_one_step(model: AffineModel) -> None:
    states = random_states(3, 2)
    whole = predict(states, model, 0.2)
    halves = predict(predict(states, model, 0.1), model, 0.1)
    assert halves.mean == pytest.approx(whole.mean)
    assert halves.covariance == pytest.approx(whole.covariance)


def test_one_certain_target_is_a_textbook_kalman_filter() -> None:
    """P_D = 1 and hardly any clutter: 30 steps of predict and update as any textbook has them."""
    model = ConstantVelocity("straight", 4.0)
    rng = np.random.default_rng(3)
    states = Gaussians(np.zeros((1, 6)), np.diag([4.0, 4.0, 100.0, 100.0, 0.0, 0.0])[None])
    x, p = np.zeros(6), states.covariance[0]
    h = np.eye(2, 6)
    for k in range(30):
        z = np.array([2.0 * k, -1.0 * k]) + rng.normal(0.0, 1.0, 2)
        f, u, q = transition(model, 0.1)
        x, p = f @ x + u, f @ p @ f.T + q
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + NOISE)
        x, p = x + gain @ (z - h @ x), (np.eye(6) - gain @ h) @ p

        states = predict(states, model, 0.1)
        seen = innovations(states, z[None], NOISE)
        beta = associate(seen.density, 1.0, 1e-12).beta
        states = update(states, seen, beta, NOISE)
        assert states.mean[0] == pytest.approx(x, abs=1e-9)
        assert states.covariance[0] == pytest.approx(p, abs=1e-9)


def test_density_and_distance_by_hand() -> None:
    """S = diag(1 + 3, 4 + 5): at (2, 3) the squared distance is 1 + 1, the density exp(-1) / (2 pi 6)."""
    states = Gaussians(np.zeros((1, 6)), np.diag([1.0, 4.0, 0, 0, 0, 0])[None])
    seen = innovations(states, np.array([[2.0, 3.0]]), np.diag([3.0, 5.0]))
    assert seen.distance == pytest.approx(np.array([[2.0]]))
    assert seen.density == pytest.approx(np.array([[np.exp(-1.0) / (12.0 * np.pi)]]))


def test_update_has_the_moments_of_the_mixture() -> None:
    """Mean and covariance of the Gaussians that each measurement alone would give, mixed by beta."""
    states = random_states(2, 4)
    centres = np.array([[3.0, 1.0], [-2.0, 4.0], [0.0, 0.0]])
    beta = np.array([[0.2, 0.5, 0.3, 0.0], [0.6, 0.0, 0.1, 0.3]])
    seen = innovations(states, centres, NOISE)
    mixed = update(states, seen, beta, NOISE)
    for i in range(2):
        alone = [Gaussians(states.mean[i : i + 1], states.covariance[i : i + 1])]
        for j in range(3):
            one = innovations(alone[0], centres[j : j + 1], NOISE)
            alone.append(update(alone[0], one, np.array([[0.0, 1.0]]), NOISE))
        mean = sum(b * g.mean[0] for b, g in zip(beta[i], alone, strict=True))
        second = sum(
            b * (g.covariance[0] + np.outer(g.mean[0], g.mean[0]))
            for b, g in zip(beta[i], alone, strict=True)
        )
        assert mixed.mean[i] == pytest.approx(mean)
        assert mixed.covariance[i] == pytest.approx(second - np.outer(mean, mean))


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 5), st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_covariance_stays_symmetric_and_positive(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = random_states(n, seed)
    beta = rng.dirichlet(np.ones(m + 1), n)
    for model in MODELS:
        states = predict(states, model, float(rng.uniform(0.001, 1.0)))
        seen = innovations(states, rng.normal(0.0, 100.0, (m, 2)), NOISE)
        states = update(states, seen, beta, NOISE)
        assert np.array_equal(states.covariance, states.covariance.transpose(0, 2, 1))
        values = np.linalg.eigvalsh(states.covariance)
        assert np.all(values >= -1e-9 * values.max())


def test_a_missed_target_keeps_its_prediction() -> None:
    states = random_states(1, 6)
    seen = innovations(states, np.zeros((1, 2)), NOISE)
    after = update(states, seen, np.array([[1.0, 0.0]]), NOISE)
    assert after.mean == pytest.approx(states.mean)
    assert after.covariance == pytest.approx(states.covariance)
