"""Motion models against the closed forms of the continuous processes that they discretise.

Moments are compared over N = 400,000 draws. An entry of the sample mean has the standard error
sqrt(C_ii / N), one of the sample covariance sqrt((C_ii C_jj + C_ij^2) / N); six of them on the some
50 numbers of a comparison fail a right model with a probability below 50 * 2e-9 = 1e-7.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import (
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    FreeAcceleration,
    MotionModel,
    RandomWalk,
)
from lumpwatch.models.state import AX, AY, VX, VY, H, States, W, X, Y

Array = NDArray[np.float64]
N = 400_000
START = np.array([40.0, 30.0, 5.0, -7.0, 2.0, 3.0, 11.0, 13.0])
XS, YS = [X, VX, AX], [Y, VY, AY]
STILL = np.zeros((3, 3))

Law = tuple[Array, Array, Array]
"""Mean (8,), and the covariance of (position, velocity, acceleration) along x and along y (3, 3)."""


def wiener_velocity(dt: float, noise: float) -> Array:
    """Integral of white acceleration: velocity q dt, position q dt^3 / 3, both q dt^2 / 2."""
    return noise**2 * np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])


def wiener_acceleration(dt: float, noise: float) -> Array:
    """Integral of white jerk: entry (i, j) is q times the integral of s^(2-i)/(2-i)! s^(2-j)/(2-j)!."""
    return noise**2 * np.array(
        [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
    )


def kinematic(dt: float, velocity: tuple[float, float], acceleration: tuple[float, float]) -> Array:
    """The state after `dt` at constant acceleration."""
    v, a = np.array(velocity), np.array(acceleration)
    after = START.copy()
    after[[X, Y]] += v * dt + a * dt**2 / 2
    after[[VX, VY]] = v + a * dt
    after[[AX, AY]] = a
    return after


def expected(model: MotionModel, dt: float) -> Law:
    """Closed form of the law after `dt` seconds from START."""
    match model:
        case ConstantPosition(position_noise=noise):
            spread = np.diag([noise**2 * dt, 0.0, 0.0])
            return kinematic(dt, (0, 0), (0, 0)), spread, spread
        case RandomWalk(position_noise=noise):
            spread = np.diag([noise**2 * dt, 0.0, 0.0])
            return START, spread, spread
        case ConstantVelocity(velocity_noise=noise):
            spread = wiener_velocity(dt, noise)
            return kinematic(dt, (5, -7), (0, 0)), spread, spread
        case ConstantAcceleration(rate=rate, velocity_noise=noise):
            spread = wiener_velocity(dt, noise)
            return kinematic(dt, (5, -7), rate), spread, spread
        case FreeAcceleration(acceleration_noise=noise):
            spread = wiener_acceleration(dt, noise)
            return kinematic(dt, (5, -7), (2, 3)), spread, spread
        case Bounce(velocity_noise=noise, along_x=along_x, along_y=along_y):
            spread = wiener_velocity(dt, noise)
            return kinematic(dt, (-5 if along_x else 5, 7 if along_y else -7), (0, 0)), spread, spread
    raise AssertionError(f"no closed form for {model}")


def assert_law(states: States, law: Law) -> None:
    """First and second moments of the draws, within six standard errors."""
    mean, along_x, along_y = law
    covariance = np.zeros((8, 8))
    covariance[np.ix_(XS, XS)], covariance[np.ix_(YS, YS)] = along_x, along_y
    variance = np.diag(covariance)
    assert np.all(np.abs(states.mean(axis=0) - mean) <= 6 * np.sqrt(variance / N) + 1e-9)
    error = np.sqrt((np.outer(variance, variance) + covariance**2) / N)
    assert np.all(np.abs(np.cov(states.T) - covariance) <= 6 * error + 1e-9)


REGIMES: list[MotionModel] = [
    ConstantPosition("stand", 3.0),
    RandomWalk("walk", 3.0),
    ConstantVelocity("belt", 4.0),
    ConstantAcceleration("fall", (6.0, 90.0), 4.0),
    FreeAcceleration("free", 5.0),
]
BOUNCES: list[MotionModel] = [
    Bounce("side", 4.0, along_x=True, along_y=False),
    Bounce("floor", 4.0, along_x=False, along_y=True),
    Bounce("corner", 4.0, along_x=True, along_y=True),
]


def names(model: MotionModel) -> str:
    return model.name


@pytest.mark.parametrize("dt", [0.04, 1.5])
@pytest.mark.parametrize("model", REGIMES + BOUNCES, ids=names)
def test_law_of_one_step(model: MotionModel, dt: float) -> None:
    moved = model.move(np.tile(START, (N, 1)), dt, np.random.default_rng(1))
    assert_law(moved, expected(model, dt))


@pytest.mark.parametrize("model", REGIMES, ids=names)
def test_two_steps_have_the_law_of_one(model: MotionModel) -> None:
    rng = np.random.default_rng(2)
    halfway = model.move(np.tile(START, (N, 1)), 0.3, rng)
    assert_law(model.move(halfway, 0.7, rng), expected(model, 1.0))


@pytest.mark.parametrize("model", REGIMES, ids=names)
def test_noise_is_gaussian(model: MotionModel) -> None:
    """The fourth standardised moment of a Gaussian is 3; over N draws its standard error is
    sqrt(24 / N) = 0.008."""
    moved = model.move(np.tile(START, (N, 1)), 0.5, np.random.default_rng(3))
    for column in (X, Y):
        standard = (moved[:, column] - moved[:, column].mean()) / moved[:, column].std()
        assert abs((standard**4).mean() - 3.0) < 6 * np.sqrt(24 / N)


@pytest.mark.parametrize(
    ("along_x", "along_y", "expected_state"),
    # From (40, 30) at (5, -7) px/s; two seconds after the reflection.
    [
        (True, False, [30, 16, -5, -7]),
        (False, True, [50, 44, 5, 7]),
        (True, True, [30, 44, -5, 7]),
    ],
)
def test_bounce_reflects_and_moves_on(along_x: bool, along_y: bool, expected_state: list[float]) -> None:
    model = Bounce("bounce", 0.0, along_x, along_y)
    moved = model.move(START[None], 2.0, np.random.default_rng(0))
    assert np.allclose(moved[0, :4], expected_state, atol=1e-12)


def test_only_bounces_are_momentary() -> None:
    assert not any(model.momentary for model in REGIMES)
    assert all(model.momentary for model in BOUNCES)


@pytest.mark.parametrize("model", REGIMES + BOUNCES, ids=names)
def test_input_and_size_are_not_changed(model: MotionModel) -> None:
    states = np.tile(START, (7, 1))
    states.setflags(write=False)
    moved = model.move(states, 0.1, np.random.default_rng(0))
    assert np.array_equal(states, np.tile(START, (7, 1)))
    assert not np.shares_memory(states, moved)
    assert np.array_equal(moved[:, [W, H]], states[:, [W, H]])


@pytest.mark.parametrize("model", REGIMES + BOUNCES, ids=names)
def test_same_seed_same_bytes(model: MotionModel) -> None:
    states = np.tile(START, (50, 1))
    first, again, other = (model.move(states, 0.1, np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


@pytest.mark.parametrize("model", REGIMES + BOUNCES, ids=names)
def test_no_state_gives_no_state(model: MotionModel) -> None:
    assert model.move(np.empty((0, 8)), 0.1, np.random.default_rng(0)).shape == (0, 8)


def enlarged(model: MotionModel, factor: float) -> MotionModel:
    """The same law where every length is `factor` times as long."""
    match model:
        case ConstantPosition() | RandomWalk():
            return type(model)(model.name, model.position_noise * factor)
        case ConstantVelocity():
            return ConstantVelocity(model.name, model.velocity_noise * factor)
        case ConstantAcceleration():
            rate = (model.rate[0] * factor, model.rate[1] * factor)
            return ConstantAcceleration(model.name, rate, model.velocity_noise * factor)
        case FreeAcceleration():
            return FreeAcceleration(model.name, model.acceleration_noise * factor)
        case Bounce():
            return Bounce(model.name, model.velocity_noise * factor, model.along_x, model.along_y)
    raise AssertionError(f"no scaling for {model}")


@pytest.mark.parametrize("model", REGIMES + BOUNCES, ids=names)
@settings(max_examples=25)
@given(factor=st.floats(0.05, 20.0), dt=st.floats(1e-3, 3.0), seed=st.integers(0, 1000))
def test_scaling_lengths_scales_the_result(model: MotionModel, factor: float, dt: float, seed: int) -> None:
    states = np.tile(START, (20, 1))
    plain = model.move(states, dt, np.random.default_rng(seed))
    large = enlarged(model, factor).move(states * factor, dt, np.random.default_rng(seed))
    assert np.allclose(large, plain * factor, rtol=1e-9, atol=1e-9)
