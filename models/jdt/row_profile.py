"""How objects look and move at each row of the picture.

A camera looks along the belt: the same lump is larger and faster near the camera. The profile holds
mean and spread of velocity and of log size by row, learned from labelled boxes by a kernel average
over rows, or a stated default that knows nothing. Newborn particles take their size and velocity
from it, and a moving particle keeps its size relative to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import as_finite, check_shape, settle
from lumpwatch.models.state import SIZE, VX, VY, H, States, W, Y

ASPECT = 0.2
"""Standard deviation of the log of width over height around what is usual at the row, where none was learned."""
SIZE_MEMORY_S = 5.0
"""Time after which an object's size relative to its row is forgotten to 1/e."""
SIZE_LIMIT = 2.0
"""Sizes lie within this many standard deviations: evidence gathers without end, so a size that is only
improbable would in time be believed, and a medium rock taken for a small lump."""


@dataclass(frozen=True, slots=True)
class RowProfile:
    """Mean and standard deviation of (vx, vy, log w, log h) on regularly spaced rows."""

    first_row: float
    row_step: float
    mean: NDArray[np.float64]
    """(rows, 4)"""
    spread: NDArray[np.float64]
    """(rows, 4)"""
    aspect_spread: float = np.inf
    """Standard deviation of log(w / h) around what the row expects; infinite: sides do not know each other."""

    def __post_init__(self) -> None:
        """Raises ValueError for a mean or spread that is not (rows, 4) and finite, and rows without a distance."""
        mean = as_finite(self.mean, ("rows", 4), "mean")
        settle(self, {"mean": mean, "spread": as_finite(self.spread, (len(mean), 4), "spread")})
        if (self.spread < 0.0).any():
            raise ValueError("spread must not be negative")
        if len(mean) == 0 or not 0.0 < self.row_step < float("inf"):
            raise ValueError(
                f"row_step must be positive and finite, with one row or more, not {self.row_step}"
            )

    def at(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and spread (n, 4) at the rows (n,); the ends hold beyond them."""
        return _interpolate(rows, self.first_row, self.row_step, self.mean, self.spread)

    def log_size(self, height: int) -> NDArray[np.float64]:
        """Mean log size, of root of width times height, at the rows of a picture (height,)."""
        mean, _ = self.at(np.arange(height, dtype=np.float64) + 0.5)
        return 0.5 * (mean[:, 2] + mean[:, 3])

    def follow(self, before: States, after: States, dt: float, rng: np.random.Generator) -> None:
        """Give the moved particles their sizes after `dt` seconds (in place).

        The deviation of the log size from what the row expects is an Ornstein-Uhlenbeck process whose
        stationary law is that of newborn particles: a lump keeps its relative size for a while, and no
        particle drifts off to a size that no lump has.
        """
        keep = exp(-dt / SIZE_MEMORY_S)
        most = SIZE_LIMIT * self.aspect_spread
        _follow(before, after, keep, self.first_row, self.row_step, self.mean, self.spread, most, rng)

    def draw(self, rows: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Velocity x, y, width and height (n, 4) of newborn objects at the rows (n,)."""
        most = SIZE_LIMIT * self.aspect_spread
        return _draw(rows, self.first_row, self.row_step, self.mean, self.spread, most, rng)

    def scaled(self, factor: float) -> RowProfile:
        """The profile for a picture scaled by `factor`."""
        mean, spread = self.mean.copy(), self.spread.copy()
        mean[:, :2] *= factor
        spread[:, :2] *= factor
        mean[:, 2:] += np.log(factor)
        return RowProfile(self.first_row * factor, self.row_step * factor, mean, spread, self.aspect_spread)


SMALLEST, LARGEST = 0.8, 2.4
"""Range of the lumps that are looked for in units of the limit. Smaller ones are followed too, so that a rock
near the limit is measured and not taken for the smallest lump."""


def around_limit(profile: RowProfile, limit_px: NDArray[np.float64] | None) -> RowProfile:
    """The profile with the sizes of what lies around a limit: `limit_px` (h,) is its side by row, px.

    None: no limit is known, and the profile stays as it is.

    What was learned of the ratio of width to height stays. A handful of labelled lumps shows neither the
    smallest nor the largest that will come; the limit does. Where the usual sizes lie beyond what follows from
    it, up to one standard deviation above them is looked for as well.
    """
    if limit_px is None:
        return profile
    mean, spread = profile.mean.copy(), profile.spread.copy()
    rows = profile.first_row + profile.row_step * np.arange(len(mean))
    limit = np.log(np.interp(rows, np.arange(len(limit_px)) + 0.5, limit_px))
    usual = 0.5 * (mean[:, 2] + mean[:, 3]) + spread[:, 2:].max(axis=1)
    low, high = limit + np.log(SMALLEST), np.maximum(limit + np.log(LARGEST), usual)
    middle, half_aspect = 0.5 * (low + high), 0.5 * (mean[:, 2] - mean[:, 3])
    mean[:, 2], mean[:, 3] = middle + half_aspect, middle - half_aspect
    spread[:, 2:] = (0.5 * (high - low) / SIZE_LIMIT)[:, None]
    return RowProfile(profile.first_row, profile.row_step, mean, spread, min(profile.aspect_spread, ASPECT))


def default_profile(height: float, smallest: float, largest: float, speed: float) -> RowProfile:
    """A profile that does not depend on the row.

    Widths and heights are spread around the geometric mean of `smallest` and `largest` (px) so that
    those lie two standard deviations out; velocities around zero along x and half of `speed` (px/s)
    downwards, with `speed` two standard deviations above zero.

    Raises ValueError for a height or sizes that are not positive, sizes the wrong way round, and a negative speed.
    """
    if not 0.0 < height < float("inf"):
        raise ValueError(f"height must be positive and finite, not {height}")
    if not 0.0 < smallest <= largest < float("inf") or not 0.0 <= speed < float("inf"):
        raise ValueError(
            f"smallest and largest must be positive sizes in this order and speed not negative, "
            f"not {smallest}, {largest} and {speed}"
        )
    middle = 0.5 * (np.log(smallest) + np.log(largest))
    width = 0.25 * (np.log(largest) - np.log(smallest))
    mean = np.array([[0.0, 0.5 * speed, middle, middle]])
    spread = np.array([[0.1 * speed, 0.5 * speed, width, width]])
    return RowProfile(0.0, max(height, 1.0), np.repeat(mean, 2, axis=0), np.repeat(spread, 2, axis=0))


NARROWEST = 0.3
"""A region's far end is taken for no smaller than this share of its widest row: polygons are drawn by hand."""
_FULL_SIZE = 0.75
"""Quantile of the rows at which a lump is as large as is said of the region as a whole."""


def along_polygon(profile: RowProfile, mask: NDArray[np.uint8]) -> RowProfile:
    """The profile with sizes that grow with the width of the polygon `mask` (h, w), 1 inside and 0 outside.

    A polygon that follows the edges of a belt shows by how much the belt comes nearer: its width at each row is a
    straight line, and so is the size of a lump. Velocities stay as they are. A mask without a row is left alone.
    """
    widths = mask.sum(axis=1, dtype=np.float64)
    inside = np.flatnonzero(widths)
    if len(inside) < 2:
        return profile
    height = len(widths)
    slope, offset = np.polyfit(inside, widths[inside], 1)
    line = slope * np.arange(height) + offset
    line = np.maximum(line, NARROWEST * line.max())
    knots = np.linspace(0.0, height, 17)
    mean, spread = profile.at(knots)
    mean[:, 2:] += np.log(np.interp(knots, np.arange(height), line) / np.quantile(line, _FULL_SIZE))[:, None]
    return RowProfile(0.0, float(knots[1]), mean, spread, profile.aspect_spread)


def untrained_profile(mask: NDArray[np.uint8], size_h: tuple[float, float], speed_h: float) -> RowProfile:
    """What is taken for granted in a region `mask` (h, w) of which nothing was learned.

    `size_h`: smallest and largest object, and `speed_h`: speed a second, in heights of the region.
    """
    height = float(mask.shape[0])
    flat = default_profile(height, size_h[0] * height, size_h[1] * height, speed_h * height)
    return along_polygon(flat, mask)


def learn_profile(states: States, height: float, least_log_size_spread: float = 0.1) -> RowProfile:
    """The profile of training states (n, 8) in a picture of `height` rows, by a kernel average over rows.

    The bandwidth is a tenth of the height. Spreads are widened by a tenth of the mean speed, so that
    an object somewhat faster than all examples can still be born. Raises ValueError without states.
    """
    if len(states) == 0:
        raise ValueError("no training states: a row profile needs at least one")
    check_shape(states, ("n", SIZE), "states")
    rows = np.linspace(0.0, height, 17)
    values = np.column_stack([states[:, VX], states[:, VY], np.log(states[:, W]), np.log(states[:, H])])
    log_kernel = -0.5 * ((rows[:, None] - states[None, :, Y]) / (0.1 * height)) ** 2
    kernel = np.exp(log_kernel - log_kernel.max(axis=1, keepdims=True))
    kernel /= kernel.sum(axis=1, keepdims=True)
    mean = kernel @ values
    variance = np.maximum(kernel @ values**2 - mean**2, 0.0)
    floor = np.array([0.0, 0.0, least_log_size_spread, least_log_size_spread])
    margin = np.column_stack([np.repeat(0.1 * np.hypot(mean[:, 0], mean[:, 1])[:, None], 2, axis=1)])
    spread = np.maximum(np.sqrt(variance), floor)
    spread[:, :2] += margin + 1e-3 * height
    return RowProfile(0.0, float(rows[1]), mean, spread)


@njit(cache=True)
def _knots(row, first_row, row_step, knots):  # type: ignore[no-untyped-def]
    """The knots below and above a row, and how far it is from the first to the second."""
    position = min(max((row - first_row) / row_step, 0.0), knots - 1.0)
    low = min(int(position), max(knots - 2, 0))
    return low, min(low + 1, knots - 1), position - low


@njit(cache=True)
def _interpolate(rows, first_row, row_step, mean, spread):  # type: ignore[no-untyped-def]
    knots, quantities = mean.shape
    means = np.empty((len(rows), quantities))
    spreads = np.empty((len(rows), quantities))
    for i in range(len(rows)):
        low, high, part = _knots(rows[i], first_row, row_step, knots)
        for k in range(quantities):
            means[i, k] = mean[low, k] * (1.0 - part) + mean[high, k] * part
            spreads[i, k] = spread[low, k] * (1.0 - part) + spread[high, k] * part
    return means, spreads


@njit(cache=True)
def _agree(deviations, most):  # type: ignore[no-untyped-def]
    """Bring the deviations of width and height to within `most` of each other; the area stays."""
    excess = 0.5 * (abs(deviations[0] - deviations[1]) - most)
    if excess > 0.0:
        towards = excess if deviations[0] < deviations[1] else -excess
        deviations[0] += towards
        deviations[1] -= towards


@njit(cache=True)
def _follow(before, after, keep, first_row, row_step, mean, spread, most, rng):  # type: ignore[no-untyped-def]
    knots = len(mean)
    noise = np.sqrt(1.0 - keep * keep)
    deviations, centres = np.empty(2), np.empty(2)
    for i in range(len(before)):
        low, high, part = _knots(before[i, Y], first_row, row_step, knots)
        new_low, new_high, new_part = _knots(after[i, Y], first_row, row_step, knots)
        for k in range(2, 4):
            expected = mean[low, k] * (1.0 - part) + mean[high, k] * part
            new_expected = mean[new_low, k] * (1.0 - new_part) + mean[new_high, k] * new_part
            new_spread = spread[new_low, k] * (1.0 - new_part) + spread[new_high, k] * new_part
            deviation = keep * (np.log(max(before[i, W - 2 + k], 1e-3)) - expected)
            deviation += noise * new_spread * rng.standard_normal()
            limit = SIZE_LIMIT * new_spread
            deviations[k - 2] = min(max(deviation, -limit), limit)
            centres[k - 2] = new_expected
        _agree(deviations, most)
        after[i, W] = np.exp(centres[0] + deviations[0])
        after[i, H] = np.exp(centres[1] + deviations[1])


@njit(cache=True)
def _draw(rows, first_row, row_step, mean, spread, most, rng):  # type: ignore[no-untyped-def]
    knots = len(mean)
    values = np.empty((len(rows), 4))
    deviations = np.empty(2)
    for i in range(len(rows)):
        low, high, part = _knots(rows[i], first_row, row_step, knots)
        for k in range(4):
            deviation = rng.standard_normal()
            if k >= 2:
                deviation = min(max(deviation, -SIZE_LIMIT), SIZE_LIMIT)
            values[i, k] = mean[low, k] * (1.0 - part) + mean[high, k] * part
            deviation *= spread[low, k] * (1.0 - part) + spread[high, k] * part
            if k >= 2:
                deviations[k - 2] = deviation
            else:
                values[i, k] += deviation
        _agree(deviations, most)
        values[i, 2] = np.exp(values[i, 2] + deviations[0])
        values[i, 3] = np.exp(values[i, 3] + deviations[1])
    return values
