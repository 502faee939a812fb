"""A motion model of your own.

Any object with `name`, `momentary` and `move` is a motion model. This one slows down by friction. Twenty objects
slide from a known place; the filter's share of each model says which it believes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from docs.gallery.square import make_filter
from lumpwatch.models import Belief, ConstantVelocity, blank

DT = 0.1


@dataclass(frozen=True)
class Sliding:
    """v' = -friction v, with a little jitter of the velocity."""

    name: str
    friction_hz: float
    jitter: float
    momentary: bool = False

    def move(self, states: NDArray[np.float64], dt: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """The states (n, 8) after `dt` seconds; columns are x, y, vx, vy, ax, ay, width, height."""
        moved, kept = states.copy(), np.exp(-self.friction_hz * dt)
        moved[:, 2:4] = kept * states[:, 2:4] + self.jitter * np.sqrt(dt) * rng.standard_normal(
            (len(states), 2)
        )
        moved[:, :2] += states[:, 2:4] * (1.0 - kept) / self.friction_hz
        return moved


@dataclass(frozen=True)
class Measured:
    """The likelihood of a measured centre, 4 px to each side."""

    centre: NDArray[np.float64]

    def log_ratio(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log p(z | x) over that of a picture without the object (n,)."""
        return 4.0 - 0.5 * np.sum(np.square((states[:, :2] - self.centre) / 4.0), axis=1)


def main(picture: Path = Path("own_motion_model.png")) -> None:
    """Slide, follow, and draw speed and shares."""
    rng = np.random.default_rng(2)
    slides = Sliding("slides", 1.5, 5.0)
    jdt = make_filter((ConstantVelocity("straight", 5.0), slides), np.array([[0.95, 0.05], [0.05, 0.95]]))
    shares, speeds = [], []
    for _ in range(20):
        state, first = blank(1), blank(len(jdt.start(rng).states))
        state[0, :4] = 20.0, rng.uniform(40.0, 80.0), 90.0, 0.0
        first[:, :4] = state[0, :4] + rng.normal(0.0, (4.0, 4.0, 30.0, 5.0), (len(first), 4))
        first[:, 6:] = 20.0
        belief = Belief(first, rng.integers(0, 2, len(first)), np.ones(len(first), np.bool_), existence=1.0)
        share, speed = [], []
        for _ in range(20):
            state = slides.move(state, DT, rng)
            step = jdt.step(belief, Measured(state[0, :2] + rng.normal(0.0, 4.0, 2)), DT, rng)
            belief = step.belief
            share.append(step.estimate.model_shares[1] if step.estimate else np.nan)
            speed.append(step.estimate.mean[2] if step.estimate else np.nan)
        shares.append(share)
        speeds.append(speed)
    at = DT * np.arange(1, 21)
    figure, axes = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
    axes[0].plot(at, np.transpose(speeds), color="tab:blue", alpha=0.3)
    axes[0].plot(at, 90.0 * np.exp(-1.5 * at), "k", label="without jitter")
    axes[0].set(xlabel="time (s)", ylabel="velocity along x (px/s)", title="followed")
    axes[0].legend()
    axes[1].plot(at, np.nanmean(shares, axis=0))
    axes[1].set(xlabel="time (s)", title="mean share of the model that slides", ylim=(0, 1))
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
