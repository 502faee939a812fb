"""A motion model of a user's own, as docs/models.md shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumpwatch.models.state import VX, VY, States, X, Y


@dataclass(frozen=True)
class Sliding:
    """The object slows down by friction: v' = -friction v."""

    name: str
    height: float
    friction_hz: float = 1.0
    jitter_h: float = 0.02
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        moved = states.copy()
        kept = np.exp(-self.friction_hz * dt)
        moved[:, [VX, VY]] *= kept
        moved[:, [X, Y]] += states[:, [VX, VY]] * (1 - kept) / self.friction_hz
        moved[:, [X, Y]] += self.jitter_h * self.height * np.sqrt(dt) * rng.standard_normal((len(states), 2))
        return moved
