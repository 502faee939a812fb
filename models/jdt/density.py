"""Kernel densities p(x_{t-1} | alpha_t) on a grid (paper 1, Eq. 14).

A density is a sum of Gaussian kernels over the training states. It is evaluated once on a regular
grid of one or two state components and interpolated linearly from there on. With knots h apart the
error against the exact sum is at most h^2/8 max|p''| in one dimension (twice that in two); knots a
fifth of the bandwidth apart keep it below 0.5 % of the kernel's peak (1 % in two dimensions). A grid
has at most 4096 knots, or 256 along each of two axes: then h, and with it the bound, is larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import check_shape
from lumpwatch.models.state import SIZE, VY, States, X, Y

COMPONENTS: dict[str, tuple[int, ...]] = {
    "row": (Y,),
    "column": (X,),
    "position": (X, Y),
    "vertical_velocity": (VY,),
}
"""Named sets of state components over which a density can be learned."""

_REACH = 6.0  # a Gaussian kernel six bandwidths away is 1.5e-8 of its peak
_KNOTS_PER_BANDWIDTH = 5.0
_MAX_KNOTS = {1: 4096, 2: 256}


@dataclass(frozen=True, slots=True)
class GridDensity:
    """One density for each motion model on a common grid."""

    components: tuple[int, ...]
    """State columns, one or two."""
    origin: NDArray[np.float64]
    """Coordinates of the first knot (d,)."""
    step: NDArray[np.float64]
    """Distance between knots (d,)."""
    values: NDArray[np.float64]
    """(M, n) or (M, n_first, n_second); zero everywhere for a model without samples."""

    def __post_init__(self) -> None:
        """Raises ValueError where origin, step or values do not fit one or two components."""
        d = len(self.components)
        if d not in (1, 2):
            raise ValueError(f"components must be one or two columns of the state, not {d}")
        check_shape(self.origin, (d,), "origin")
        check_shape(self.step, (d,), "step")
        check_shape(self.values, ("models", "n", "m")[: d + 1], "values")

    def at(self, states: States) -> NDArray[np.float64]:
        """Densities (n, M) of every model at the states (n, 8); zero outside the grid."""
        if len(self.components) == 1:
            return _interpolate_1d(states[:, self.components[0]], self.origin[0], self.step[0], self.values)
        a, b = self.components
        return _interpolate_2d(states[:, a], states[:, b], self.origin, self.step, self.values)

    def scaled(self, factor: float) -> GridDensity:
        """The densities for a picture scaled by `factor`."""
        d = len(self.components)
        return GridDensity(self.components, self.origin * factor, self.step * factor, self.values / factor**d)


Bandwidth = Literal["scott", "silverman", "likelihood"]
"""How wide the kernels are: a rule for Gaussian data, or the leave-one-out likelihood of the samples."""
_MOST_FOR_LIKELIHOOD = 500


def bandwidth_of(samples: NDArray[np.float64], rule: Bandwidth, least: float) -> NDArray[np.float64]:
    """Bandwidth (d,) for samples (n, d) by a rule, at least `least` in every component."""
    widths = scott(samples)
    n, d = samples.shape
    if rule == "silverman":
        widths = widths * (4.0 / (d + 2.0)) ** (1.0 / (d + 4))
    if rule == "likelihood" and n > 2:
        tried = [np.maximum(factor * widths, least) for factor in np.geomspace(0.1, 2.0, 25)]
        return tried[int(np.argmax([leave_one_out(samples, width) for width in tried]))]
    return np.maximum(widths, least)


def leave_one_out(samples: NDArray[np.float64], bandwidth: NDArray[np.float64]) -> float:
    """Mean log density of each sample under the kernels of all others (Duin 1976).

    Of more than 500 samples an even selection speaks for all.
    """
    chosen = samples[:: max(1, len(samples) // _MOST_FOR_LIKELIHOOD)]
    n, d = chosen.shape
    difference = (chosen[:, None, :] - chosen[None, :, :]) / bandwidth
    kernel = np.exp(-0.5 * np.square(difference).sum(axis=-1))
    np.fill_diagonal(kernel, 0.0)
    norm = (n - 1) * np.prod(bandwidth) * (2 * np.pi) ** (d / 2)
    return float(np.mean(np.log(np.maximum(kernel.sum(axis=1) / norm, 1e-300))))


def scott(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scott's rule: n^(-1/(d+4)) times the standard deviation of each component; samples (n, d)."""
    n, d = samples.shape
    spread: NDArray[np.float64] = samples.std(axis=0, ddof=1) if n > 1 else np.zeros(d)
    return spread * n ** (-1.0 / (d + 4))


def kernel_sum(
    at: NDArray[np.float64], samples: NDArray[np.float64], bandwidth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Eq. 14 exactly: mean of Gaussian kernels at the points (m, d) over the samples (n, d)."""
    d = samples.shape[1]
    norm = np.prod(bandwidth) * (2 * np.pi) ** (d / 2) * len(samples)
    total = np.empty(len(at))
    for start in range(0, len(at), 1024):  # bounds the memory of the (points, samples) table
        difference = (at[start : start + 1024, None, :] - samples[None, :, :]) / bandwidth
        total[start : start + 1024] = np.exp(-0.5 * np.square(difference).sum(axis=-1)).sum(axis=1)
    return total / norm


def learn(
    states: States,
    labels: NDArray[np.intp],
    models: int,
    components: tuple[int, ...],
    least_bandwidth: float,
    rule: Bandwidth = "scott",
) -> GridDensity:
    """Densities of the components for each of the `models`, from states (n, 8) and their labels (n,).

    `least_bandwidth` keeps a model that was seen at one spot only from becoming a spike. Raises
    ValueError where there is no sample at all.
    """
    if len(states) == 0:
        raise ValueError("no training states: a density needs at least one")
    check_shape(states, ("n", SIZE), "states")
    check_shape(labels, (len(states),), "labels")
    if least_bandwidth <= 0:
        raise ValueError("least_bandwidth must be positive")
    data = states[:, list(components)]
    by_model = [data[labels == m] for m in range(models)]
    widths = [bandwidth_of(part, rule, least_bandwidth) if len(part) else None for part in by_model]
    reach = _REACH * np.max([w for w in widths if w is not None], axis=0)
    low, high = data.min(axis=0) - reach, data.max(axis=0) + reach
    finest = np.min([w for w in widths if w is not None], axis=0)
    counts = np.ceil((high - low) * _KNOTS_PER_BANDWIDTH / finest).astype(int) + 1
    counts = np.clip(counts, 2, _MAX_KNOTS[len(components)])
    step = (high - low) / (counts - 1)
    axes = [low[k] + step[k] * np.arange(counts[k]) for k in range(len(components))]
    knots = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    values = np.zeros((models, *counts))
    for m, (part, width) in enumerate(zip(by_model, widths, strict=True)):
        if width is not None:
            values[m] = kernel_sum(knots, part, width).reshape(tuple(counts))
    return GridDensity(components, low, step, values)


@njit(cache=True)
def _interpolate_1d(x, origin, step, values):  # type: ignore[no-untyped-def]
    models, knots = values.shape
    out = np.zeros((len(x), models))
    for i in range(len(x)):
        t = (x[i] - origin) / step
        if not (0.0 <= t <= knots - 1):
            continue
        k = min(int(t), knots - 2)
        f = t - k
        for m in range(models):
            out[i, m] = values[m, k] * (1.0 - f) + values[m, k + 1] * f
    return out


@njit(cache=True)
def _interpolate_2d(x, y, origin, step, values):  # type: ignore[no-untyped-def]
    models, nx, ny = values.shape
    out = np.zeros((len(x), models))
    for i in range(len(x)):
        s = (x[i] - origin[0]) / step[0]
        t = (y[i] - origin[1]) / step[1]
        if not (0.0 <= s <= nx - 1 and 0.0 <= t <= ny - 1):
            continue
        k, j = min(int(s), nx - 2), min(int(t), ny - 2)
        f, g = s - k, t - j
        for m in range(models):
            near = values[m, k, j] * (1.0 - g) + values[m, k, j + 1] * g
            far = values[m, k + 1, j] * (1.0 - g) + values[m, k + 1, j + 1] * g
            out[i, m] = near * (1.0 - f) + far * f
    return out
