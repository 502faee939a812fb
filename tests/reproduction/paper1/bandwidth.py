"""Kernel densities whose bandwidth is chosen by leave-one-out likelihood.

Scott's rule takes the spread of all samples for the width of one hump. Bounces happen at two borders
or two bats with nothing between: there the rule blurs the two places into one. The bandwidth here is
Scott's times the factor under which each sample is most probable given all others of its model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.density import GridDensity, kernel_sum, scott
from models.state import States

FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08)
_KNOTS = {1: 1024, 2: 128}
_REACH = 6.0


def learn(
    states: States, labels: NDArray[np.intp], models: int, components: tuple[int, ...], least: float
) -> GridDensity:
    """Densities of the components for each model; see `models.density.learn`."""
    data = states[:, list(components)]
    parts = [data[labels == m] for m in range(models)]
    widths = [chosen(part, least) if len(part) else np.full(len(components), least) for part in parts]
    reach = _REACH * np.max(widths, axis=0)
    low, high = data.min(axis=0) - reach, data.max(axis=0) + reach
    knots = _KNOTS[len(components)]
    step = (high - low) / (knots - 1)
    axes = [low[k] + step[k] * np.arange(knots) for k in range(len(components))]
    at = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    shape = (knots,) * len(components)
    values = [
        kernel_sum(at, part, width).reshape(shape) if len(part) else np.zeros(shape)
        for part, width in zip(parts, widths, strict=True)
    ]
    return GridDensity(components, low, step, np.stack(values))


def chosen(samples: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """The bandwidth (d,) of the samples (n, d), at least `least`."""
    candidates = [np.maximum(factor * scott(samples), least) for factor in FACTORS]
    return candidates[int(np.argmax([left_out(samples, width) for width in candidates]))]


def left_out(samples: NDArray[np.float64], bandwidth: NDArray[np.float64]) -> float:
    """Mean log density of each sample under the kernels of all others; -inf for one sample."""
    n, d = samples.shape
    if n < 2:
        return float("-inf")
    own = 1.0 / (n * np.prod(bandwidth) * (2 * np.pi) ** (d / 2))
    others = (kernel_sum(samples, samples, bandwidth) - own) * n / (n - 1)
    return float(np.log(np.maximum(others, 1e-300)).mean())
