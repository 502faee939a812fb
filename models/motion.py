"""Motion models: the law p(x_t | x_{t-1}, model) of a particle, continuous in the time step.

Noise is the exact discretisation of a continuous process, so that two half steps have the same law
as one whole step. A noise parameter is the standard deviation that gathers in one second:

    constant position      p' = p,                    v' = 0        (+ Wiener noise on p)
    random walk            p' = p + w                 (the velocity is kept for a later model)
    constant velocity      v' = v + w                 (white-noise acceleration)
    constant acceleration  v' = v + a dt + w          (a given rate a; paper 1, section 4.4)
    free acceleration      a' = a + w                 (white-noise jerk; paper 2, Eq. 12)
    bounce                 v' = -v + w on an axis     (an event at the start of the step)

Sources: paper 1, section 4; paper 2, Eq. 10-12; Bar-Shalom, Li, Kirubarajan (2001), section 6.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.state import AX, AY, VX, VY, States, X, Y

Noise = NDArray[np.float64]


class MotionModel(Protocol):
    """What a user writes to add a motion model: its name, whether it is momentary, and `move`."""

    @property
    def name(self) -> str:
        """Name in configurations, labels and states."""

    @property
    def momentary(self) -> bool:
        """True for an event that lasts one step however short (a bounce), false for a regime."""

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Draw the states (n, 8) after `dt` seconds; `states` is not changed."""


def _wiener_velocity(
    states: States, dt: float, noise: float, rng: np.random.Generator, rate: tuple[float, float] = (0.0, 0.0)
) -> States:
    """Integrate p' = v, v' = rate + white noise exactly over `dt`, in a fresh array."""
    moved = states.copy()
    kick = rng.standard_normal((len(states), 4))
    velocity_kick = noise * np.sqrt(dt) * kick[:, :2]
    position_kick = 0.5 * dt * velocity_kick + noise * np.sqrt(dt**3 / 12.0) * kick[:, 2:]
    drift = np.asarray(rate) * dt
    moved[:, X : Y + 1] += states[:, VX : VY + 1] * dt + 0.5 * drift * dt + position_kick
    moved[:, VX : VY + 1] += drift + velocity_kick
    moved[:, AX] = rate[0]
    moved[:, AY] = rate[1]
    return moved


@dataclass(frozen=True, slots=True)
class ConstantPosition:
    """The object stands: velocity and acceleration are zero (paper 2, Eq. 10)."""

    name: str
    position_noise: float
    """px gathered in one second."""
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Diffuse the position and stop."""
        moved = states.copy()
        moved[:, X : Y + 1] += self.position_noise * np.sqrt(dt) * rng.standard_normal((len(states), 2))
        moved[:, VX : AY + 1] = 0.0
        return moved


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """X_t = X_{t-1} + w (paper 1, section 4.3); the velocity is kept for the model that follows."""

    name: str
    position_noise: float
    """px gathered in one second."""
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Diffuse the position."""
        moved = states.copy()
        moved[:, X : Y + 1] += self.position_noise * np.sqrt(dt) * rng.standard_normal((len(states), 2))
        return moved


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """v_t = v_{t-1} + w (paper 1, section 4.1)."""

    name: str
    velocity_noise: float
    """px/s gathered in one second."""
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Move by the velocity, with white-noise acceleration."""
        return _wiener_velocity(states, dt, self.velocity_noise, rng)


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """v_t = v_{t-1} + a dt + w at a given rate a (paper 1, section 4.4)."""

    name: str
    rate: tuple[float, float]
    """px/s^2 along x and y."""
    velocity_noise: float
    """px/s gathered in one second."""
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Move by velocity and rate, with white-noise acceleration."""
        return _wiener_velocity(states, dt, self.velocity_noise, rng, self.rate)


@dataclass(frozen=True, slots=True)
class FreeAcceleration:
    """Acceleration is part of the state and drifts (paper 2, Eq. 12; white-noise jerk)."""

    name: str
    acceleration_noise: float
    """px/s^2 gathered in one second."""
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Move by velocity and acceleration; the acceleration takes the noise."""
        covariance = np.array(
            [
                [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                [dt**3 / 6, dt**2 / 2, dt],
            ]
        )
        kick = self.acceleration_noise * (
            np.linalg.cholesky(covariance) @ rng.standard_normal((len(states), 2, 3, 1))
        ).squeeze(-1)
        moved = states.copy()
        velocity, acceleration = states[:, VX : VY + 1], states[:, AX : AY + 1]
        moved[:, X : Y + 1] += velocity * dt + 0.5 * acceleration * dt**2 + kick[..., 0]
        moved[:, VX : VY + 1] += acceleration * dt + kick[..., 1]
        moved[:, AX : AY + 1] += kick[..., 2]
        return moved


@dataclass(frozen=True, slots=True)
class Bounce:
    """v_t = -v_{t-1} + w on the chosen axes (paper 1, section 4.1), then on with that velocity."""

    name: str
    velocity_noise: float
    """px/s gathered in one second."""
    along_x: bool
    along_y: bool
    momentary: bool = True

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Reflect the velocity at the start of the step and move by it."""
        reflected = states.copy()
        if self.along_x:
            reflected[:, VX] *= -1.0
        if self.along_y:
            reflected[:, VY] *= -1.0
        return _wiener_velocity(reflected, dt, self.velocity_noise, rng)
