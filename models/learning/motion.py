"""Which motion model made each step, and the parameters of the models.

Each model predicts the velocity after a step from the velocity before it. The residual is Gaussian
with a spread of its own; the sequence of labels is a sticky Markov chain. Viterbi's path and the
parameters (rates of acceleration that the configuration leaves open, spreads) are improved in turn
until the path stands (hard expectation maximisation). Labels given in the file are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.tracks import Samples
from lumpwatch.models.state import VX, VY

Law = Literal["still", "walk", "velocity", "rate", "free", "bounce_x", "bounce_y", "bounce", "given"]
"""How a model predicts the next velocity; `given` steps are known from the labels file only."""
_STAY = 0.95
_ROUNDS = 30


@dataclass(frozen=True, slots=True)
class ModelSpec:
    """What the configuration fixes of one motion model."""

    law: Law
    rate: tuple[float, float] | None = None
    """px/s^2 of a model with a rate; None: to be learned."""

    @property
    def momentary(self) -> bool:
        """A bounce lasts one step."""
        return self.law.startswith("bounce")


@dataclass(frozen=True, slots=True)
class MotionFit:
    """Labels of all steps and the parameters of each model."""

    labels: NDArray[np.intp]
    """(k,)"""
    rates: NDArray[np.float64]
    """px/s^2 (M, 2); zero for models without a rate."""
    spreads: NDArray[np.float64]
    """Standard deviation of the velocity residual over one step, px/s (M,)."""


def fit_motion(samples: Samples, specs: Sequence[ModelSpec], least_spread: float) -> MotionFit:
    """Labels and parameters for the samples.

    `least_spread` (px/s) is a floor of every model's residual. Models whose rate is open are told
    apart by size: in the order of `specs`, the first gets the smallest acceleration.
    """
    rates = _first_rates(samples, specs)
    spreads = np.full(len(specs), max(least_spread, _robust_spread(samples)))
    labels: NDArray[np.intp] | None = None
    for _ in range(_ROUNDS):
        residuals = _residuals(samples, specs, rates)
        path = _viterbi(_log_density(residuals, spreads), samples, specs)
        if labels is not None and np.array_equal(path, labels):
            break
        labels = path
        rates, spreads = _improve(samples, specs, labels, rates, least_spread)
    assert labels is not None
    return MotionFit(labels, rates, spreads)


def _predicted(samples: Samples, spec: ModelSpec, rate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocity after the step (k, 2) by one model."""
    before = samples.states[:, VX : VY + 1]
    match spec.law:
        case "still" | "walk":
            return np.zeros_like(before)
        case "velocity" | "given":
            return before
        case "rate":
            return before + rate * samples.interval_s
        case "free":
            return before + samples.states[:, 4:6] * samples.interval_s
        case "bounce_x":
            return before * (-1.0, 1.0)
        case "bounce_y":
            return before * (1.0, -1.0)
        case "bounce":
            return -before


def _residuals(
    samples: Samples, specs: Sequence[ModelSpec], rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Squared length of the residual of every step under every model (k, M)."""
    columns = [
        np.square(samples.velocity - _predicted(samples, spec, rate)).sum(axis=1)
        for spec, rate in zip(specs, rates, strict=True)
    ]
    return np.column_stack(columns)


def _log_density(residuals: NDArray[np.float64], spreads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log density of a two-dimensional residual, up to a constant."""
    return -0.5 * residuals / spreads**2 - 2.0 * np.log(spreads)


def _first_rates(samples: Samples, specs: Sequence[ModelSpec]) -> NDArray[np.float64]:
    """Given rates, and for the open ones the centres of a one-dimensional clustering by size."""
    rates = np.array([spec.rate or (0.0, 0.0) for spec in specs], dtype=float)
    open_models = [m for m, spec in enumerate(specs) if spec.law == "rate" and spec.rate is None]
    if not open_models:
        return rates
    acceleration = (samples.velocity - samples.states[:, VX : VY + 1]) / samples.interval_s
    size = np.hypot(acceleration[:, 0], acceleration[:, 1]) * np.where(acceleration[:, 1] < 0, -1.0, 1.0)
    # The extremes seed the clusters: a fall is rare, so quantiles would all land on the belt.
    low, high = np.percentile(size, [25, 98])
    centres = np.linspace(low, high, len(open_models)) if len(open_models) > 1 else np.median(size)[None]
    for _ in range(50):
        nearest = np.abs(size[:, None] - centres).argmin(axis=1)
        moved = np.array(
            [size[nearest == c].mean() if (nearest == c).any() else centres[c] for c in range(len(centres))]
        )
        if np.allclose(moved, centres):
            break
        centres = moved
    nearest = np.abs(size[:, None] - centres).argmin(axis=1)
    for c, m in enumerate(open_models):
        chosen = nearest == c
        rates[m] = acceleration[chosen].mean(axis=0) if chosen.any() else (0.0, centres[c])
    return rates


def _robust_spread(samples: Samples) -> float:
    """Median absolute change of velocity over a step as a standard deviation."""
    change = samples.velocity - samples.states[:, VX : VY + 1]
    return float(1.4826 * np.median(np.abs(change - np.median(change, axis=0))))


def _improve(
    samples: Samples,
    specs: Sequence[ModelSpec],
    labels: NDArray[np.intp],
    rates: NDArray[np.float64],
    least_spread: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Open rates and all spreads from the labelled steps; a model without steps keeps its rate."""
    improved = rates.copy()
    acceleration = (samples.velocity - samples.states[:, VX : VY + 1]) / samples.interval_s
    settled = _settled(labels, samples.starts)
    for m, spec in enumerate(specs):
        if spec.law == "rate" and spec.rate is None and (labels == m).any():
            clear = (labels == m) & settled
            improved[m] = np.median(acceleration[clear if clear.any() else labels == m], axis=0)
    residuals = _residuals(samples, specs, improved)
    spreads = np.full(len(specs), least_spread)
    for m in range(len(specs)):
        if (chosen := labels == m).any():
            spreads[m] = max(least_spread, float(np.sqrt(residuals[chosen, m].mean() / 2.0)))
    return improved, spreads


def _settled(labels: NDArray[np.intp], starts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Steps at least three away from a switch within their track: smoothing mixes the models there."""
    switches = np.flatnonzero((np.diff(labels) != 0) & ~starts[1:])
    settled = np.ones(len(labels), dtype=np.bool_)
    for k in range(-2, 4):
        settled[np.clip(switches + k, 0, len(labels) - 1)] = False
    return settled


def _viterbi(
    log_density: NDArray[np.float64], samples: Samples, specs: Sequence[ModelSpec]
) -> NDArray[np.intp]:
    """The most probable labels of each track under a sticky chain; given labels are certain."""
    models = len(specs)
    leave = (1.0 - _STAY) / max(models - 1, 1)
    transition = np.full((models, models), leave)
    np.fill_diagonal(transition, _STAY if models > 1 else 1.0)
    momentary = [m for m, spec in enumerate(specs) if spec.momentary]
    for m in momentary:  # after a bounce comes another model
        transition[m] = 1.0 / max(models - 1, 1)
        transition[m, m] = 1e-6
    log_transition = np.log(transition)
    evidence = log_density.copy()
    evidence[:, [m for m, spec in enumerate(specs) if spec.law == "given"]] = -1e6
    known = samples.given >= 0
    evidence[known] = -1e9
    evidence[known, samples.given[known]] = 0.0

    path = np.empty(len(evidence), dtype=np.intp)
    for rows in np.split(np.arange(len(evidence)), np.flatnonzero(samples.starts)[1:]):
        score = evidence[rows[0]].copy()
        back = np.zeros((len(rows), models), dtype=np.intp)
        for i, row in enumerate(rows[1:], start=1):
            candidates = score[:, None] + log_transition
            back[i] = candidates.argmax(axis=0)
            score = candidates.max(axis=0) + evidence[row]
        path[rows[-1]] = score.argmax()
        for i in range(len(rows) - 1, 0, -1):
            path[rows[i - 1]] = back[i, path[rows[i]]]
    return path
