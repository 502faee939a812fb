"""Motion models: the law p(x_t | x_{t-1}, model) of a particle, continuous in the time step.

Noise is the exact discretisation of a continuous process, so that two half steps have the same law
as one whole step. A noise parameter is the standard deviation that gathers in one second:

    constant position      p' = p,                    v' = 0        (+ Wiener noise on p)
    random walk            p' = p + w                 (the velocity is kept for a later model)
    constant velocity      v' = v + w                 (white-noise acceleration)
    constant acceleration  v' = v + a dt + w          (a given rate a; paper 1, section 4.4)
    free acceleration      a' = a + w                 (white-noise jerk; paper 2, Eq. 12)
    bounce                 v' = -v + w on an axis     (an event at the start of the step)

All of these are affine in the state with Gaussian noise. Such a model states its coefficients as a
`law`, and one kernel moves the particles of all of them; any other model writes `move` itself.

Sources: paper 1, section 4; paper 2, Eq. 10-12; Bar-Shalom, Li, Kirubarajan (2001), section 6.2.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Protocol

import numpy as np
from numba import njit

from lumpwatch.models.checks import check_rng, check_shape
from lumpwatch.models.state import SIZE, Labels, States

Row = tuple[float, float, float, float, float, float, float]
"""Coefficients of (position, velocity, acceleration, 1, w1, w2, w3), the w independent and N(0, 1)."""
AxisLaw = tuple[Row, Row, Row]
"""What position, velocity and acceleration along one axis become."""
Law = tuple[AxisLaw, AxisLaw]
"""Along x and along y."""

_KEPT_POSITION: Row = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_KEPT_VELOCITY: Row = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_KEPT_ACCELERATION: Row = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
_ZERO: Row = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_KEPT: AxisLaw = (_KEPT_POSITION, _KEPT_VELOCITY, _KEPT_ACCELERATION)


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


class AffineModel:
    """A model that is affine in the state, with Gaussian noise: it states its law, `move` follows."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Of dataclasses: raises ValueError where a noise is negative or not finite."""
        names: Iterable[str] = getattr(self, "__dataclass_fields__", ())
        for name in names:
            noise = getattr(self, name)
            if name.endswith("_noise") and not 0.0 <= noise < float("inf"):
                raise ValueError(f"{name} of {type(self).__name__} must not be negative, not {noise}")

    def law(self, dt: float) -> Law:
        """The coefficients for a step of `dt` seconds."""
        raise NotImplementedError

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Draw the states (n, 8) after `dt` seconds; `states` is not changed.

        Raises ValueError for states of another shape, and an `rng` that is no Generator.
        """
        check_shape(states, ("n", SIZE), "states")
        check_rng(rng)
        return _move(states, np.zeros(len(states), np.intp), np.array([self.law(dt)]), rng)


def move_by_label(
    models: Sequence[MotionModel], states: States, labels: Labels, dt: float, rng: np.random.Generator
) -> States:
    """Draw the states (n, 8) after `dt` seconds, each moved by the model of its label (n,)."""
    laws = [model.law(dt) if isinstance(model, AffineModel) else (_KEPT, _KEPT) for model in models]
    moved = _move(states, labels, np.array(laws), rng)
    for m, model in enumerate(models):
        if not isinstance(model, AffineModel):
            chosen = labels == m
            if chosen.any():
                own = model.move(states[chosen], dt, rng)
                check_shape(own, (int(chosen.sum()), SIZE), f"what motion model {model.name} gives")
                moved[chosen] = own
    return moved


def _diffusing(dt: float, noise: float) -> Row:
    return (1.0, 0.0, 0.0, 0.0, noise * sqrt(dt), 0.0, 0.0)


def _wiener_velocity(dt: float, noise: float, rate: float = 0.0, sign: float = 1.0) -> AxisLaw:
    """Integrate p' = v, v' = rate + white noise exactly over `dt`, from `sign` times the velocity."""
    kick = noise * sqrt(dt)
    return (
        (1.0, sign * dt, 0.0, 0.5 * rate * dt**2, 0.5 * dt * kick, dt * kick / sqrt(12.0), 0.0),
        (0.0, sign, 0.0, rate * dt, kick, 0.0, 0.0),
        (0.0, 0.0, 0.0, rate, 0.0, 0.0, 0.0),
    )


@dataclass(frozen=True, slots=True)
class ConstantPosition(AffineModel):
    """The object stands: velocity and acceleration are zero (paper 2, Eq. 10)."""

    name: str
    position_noise: float
    """px gathered in one second."""
    momentary: bool = False

    def law(self, dt: float) -> Law:
        """Diffuse the position and stop."""
        axis = (_diffusing(dt, self.position_noise), _ZERO, _ZERO)
        return axis, axis


@dataclass(frozen=True, slots=True)
class RandomWalk(AffineModel):
    """X_t = X_{t-1} + w (paper 1, section 4.3); the velocity is kept for the model that follows."""

    name: str
    position_noise: float
    """px gathered in one second."""
    momentary: bool = False

    def law(self, dt: float) -> Law:
        """Diffuse the position."""
        axis = (_diffusing(dt, self.position_noise), _KEPT_VELOCITY, _KEPT_ACCELERATION)
        return axis, axis


@dataclass(frozen=True, slots=True)
class ConstantVelocity(AffineModel):
    """v_t = v_{t-1} + w (paper 1, section 4.1)."""

    name: str
    velocity_noise: float
    """px/s gathered in one second."""
    momentary: bool = False

    def law(self, dt: float) -> Law:
        """Move by the velocity, with white-noise acceleration."""
        axis = _wiener_velocity(dt, self.velocity_noise)
        return axis, axis


@dataclass(frozen=True, slots=True)
class ConstantAcceleration(AffineModel):
    """v_t = v_{t-1} + a dt + w at a given rate a (paper 1, section 4.4)."""

    name: str
    rate: tuple[float, float]
    """px/s^2 along x and y."""
    velocity_noise: float
    """px/s gathered in one second."""
    momentary: bool = False

    def law(self, dt: float) -> Law:
        """Move by velocity and rate, with white-noise acceleration."""
        along_x, along_y = self.rate
        return (
            _wiener_velocity(dt, self.velocity_noise, along_x),
            _wiener_velocity(dt, self.velocity_noise, along_y),
        )


@dataclass(frozen=True, slots=True)
class FreeAcceleration(AffineModel):
    """Acceleration is part of the state and drifts (paper 2, Eq. 12; white-noise jerk)."""

    name: str
    acceleration_noise: float
    """px/s^2 gathered in one second."""
    momentary: bool = False

    def law(self, dt: float) -> Law:
        """Move by velocity and acceleration; the acceleration takes the noise.

        w1 is the jerk's integral; w2 and w3 are what is left of its second and third integral.
        """
        kick = self.acceleration_noise * sqrt(dt)
        axis = (
            (
                1.0,
                dt,
                dt**2 / 2,
                0.0,
                kick * dt**2 / 6,
                kick * dt**2 / sqrt(48.0),
                kick * dt**2 / sqrt(720.0),
            ),
            (0.0, 1.0, dt, 0.0, kick * dt / 2, kick * dt / sqrt(12.0), 0.0),
            (0.0, 0.0, 1.0, 0.0, kick, 0.0, 0.0),
        )
        return axis, axis


@dataclass(frozen=True, slots=True)
class Bounce(AffineModel):
    """v_t = -v_{t-1} + w on the chosen axes (paper 1, section 4.1), then on with that velocity."""

    name: str
    velocity_noise: float
    """px/s gathered in one second."""
    along_x: bool
    along_y: bool
    momentary: bool = True

    def law(self, dt: float) -> Law:
        """Reflect the velocity at the start of the step and move by it."""
        x_sign, y_sign = -1.0 if self.along_x else 1.0, -1.0 if self.along_y else 1.0
        return (
            _wiener_velocity(dt, self.velocity_noise, sign=x_sign),
            _wiener_velocity(dt, self.velocity_noise, sign=y_sign),
        )


@njit(cache=True)
def _move(states, labels, laws, rng):  # type: ignore[no-untyped-def]
    """Apply each label's law to the columns (x, y, vx, vy, ax, ay); the size stays."""
    moved = np.empty(states.shape)
    sources = np.zeros(len(laws), np.intp)  # how many of w1, w2, w3 a law uses
    for m in range(len(laws)):
        for w in range(3):
            if np.any(laws[m, :, :, 4 + w] != 0.0):
                sources[m] = w + 1
    for i in range(len(states)):
        m = labels[i]
        for axis in range(2):
            law = laws[m, axis]
            p, v, a = states[i, axis], states[i, 2 + axis], states[i, 4 + axis]
            w1 = rng.standard_normal() if sources[m] > 0 else 0.0
            w2 = rng.standard_normal() if sources[m] > 1 else 0.0
            w3 = rng.standard_normal() if sources[m] > 2 else 0.0
            for k in range(3):
                moved[i, 2 * k + axis] = (
                    law[k, 0] * p + law[k, 1] * v + law[k, 2] * a + law[k, 3]
                    + law[k, 4] * w1 + law[k, 5] * w2 + law[k, 6] * w3
                )  # fmt: skip
        moved[i, 6], moved[i, 7] = states[i, 6], states[i, 7]
    return moved
