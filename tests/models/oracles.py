"""Exact filters to compare particle filters with: a grid, a hidden Markov model, a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineFilter:
    """The Bernoulli filter of (x, label) on a line, by summation over a regular grid (Eq. 9)."""

    knots: Array
    """Grid of x (n,)."""
    speeds: tuple[float, ...]
    noises: tuple[float, ...]
    """Drift and diffusion of each model."""
    rows: Array
    """P(alpha_t = b | x, alpha_{t-1} = a) as (a, x, b)."""
    birth: Array
    """Density of newborn (label, x), summing to 1 over both when multiplied by the grid step."""
    p_birth: float
    p_death: float
    dt: float
    model_first: bool

    @property
    def cell(self) -> float:
        return float(self.knots[1] - self.knots[0])

    def _moved(self, density: Array, model: int) -> Array:
        spread = self.noises[model] * np.sqrt(self.dt)
        gap = self.knots[:, None] - self.knots[None, :] - self.speeds[model] * self.dt
        kernel = np.exp(-0.5 * (gap / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
        return kernel @ density * self.cell

    def step(self, density: Array, existence: float, ratio: Array) -> tuple[Array, float, float]:
        """Density (label, x) given existence, existence, and the frame's evidence, for the given ratio (n,)."""
        models = range(len(self.speeds))
        if self.model_first:
            labelled = np.einsum("ax,axb->bx", density, self.rows)
            survived = np.stack([self._moved(labelled[b], b) for b in models])
        else:
            survived = np.zeros_like(density)
            for a in models:
                for b in models:
                    survived[b] += self._moved(density[a] * self.rows[a, :, b], a)
        alive, born = (1 - self.p_death) * existence, self.p_birth * (1 - existence)
        mass = (alive * survived + born * self.birth) * ratio
        total = float(mass.sum() * self.cell)
        evidence = total + 1 - alive - born
        return mass / total, total / evidence, evidence


def hmm_step(labels: Array, matrix: Array, emission: Array, model_first: bool) -> tuple[Array, float]:
    """Forward step of a hidden Markov model: label probabilities and the evidence of the frame.

    The emission belongs to the model that moved the state: the new label, or the one before.
    """
    joint = (labels @ matrix) * emission if model_first else (labels * emission) @ matrix
    evidence = float(joint.sum())
    return joint / evidence, evidence


def kalman_step(
    mean: Array, covariance: Array, dt: float, noise: float, measured: float, measured_noise: float
) -> tuple[Array, Array, float]:
    """Predict and update (position, velocity) under white-noise acceleration and a measured position.

    Third the log density of the measurement given those before it.
    """
    move = np.array([[1.0, dt], [0.0, 1.0]])
    drive = noise**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    mean, covariance = move @ mean, move @ covariance @ move.T + drive
    spread = covariance[0, 0] + measured_noise**2
    gain, surprise = covariance[:, 0] / spread, measured - mean[0]
    log_density = -0.5 * (surprise**2 / spread + np.log(2 * np.pi * spread))
    return mean + gain * surprise, covariance - np.outer(gain, covariance[0]), float(log_density)


def assert_agrees(runs: Array, exact: Array, allowance: float) -> None:
    """The mean of independent runs (seeds, ...) lies within four standard errors, plus an allowance.

    The allowance stands for what is not noise: the particle filter's own bias of order 1/N, and
    quadrature. It is stated by the caller and small against the effects tested.
    """
    error = runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    gap = np.abs(runs.mean(axis=0) - exact)
    worst = np.max(gap - 4.0 * error)
    assert np.all(gap <= 4.0 * error + allowance), f"off by {worst:.5f} beyond 4 standard errors"
