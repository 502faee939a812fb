"""How large objects are at each row, from a handful of them.

A camera looks along the belt, so sizes grow with the row: the scale of a plane's picture is a straight
line in the row. Width and height are each fitted as a line times a factor of the object's own; what the
objects differ by is pooled over all rows. A few objects do not show the range of sizes that will come,
so the spread is that of the next object (Student's prediction: the mean is uncertain as well), after
adding a stated prior: `PRIOR_OBJECTS` objects with a spread of the log size of `PRIOR_SPREAD`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.state import H, States, W, Y

PRIOR_SPREAD = 0.28
"""Standard deviation of the log size among objects: four in five within a factor of 1.4 of the middle."""
PRIOR_ASPECT = 0.13
"""The same of the log of width over height."""
PRIOR_OBJECTS = 4.0
"""How many objects that is worth."""
_FLATTEST = 0.3
"""Nowhere is an object smaller than this share of its size in the middle of the labelled rows."""
_ROUNDS = 5


def with_sizes(profile: RowProfile, states: States, starts: NDArray[np.bool_], height: float) -> RowProfile:
    """The profile with sizes fitted to objects' states (n, 8); `starts` (n,) marks each object's first.

    Boxes that the border of the picture of `height` rows may cut are left out, where others are left.
    """
    objects = np.cumsum(starts) - 1
    cut = (states[:, Y] - states[:, H] / 2 < 0.01 * height) | (
        states[:, Y] + states[:, H] / 2 > 0.99 * height
    )
    whole = ~cut if (~cut).any() else np.ones(len(states), np.bool_)
    rows = profile.first_row + profile.row_step * np.arange(len(profile.mean), dtype=np.float64)
    mean, spread = profile.mean.copy(), profile.spread.copy()
    offsets = []
    for column, side in ((2, W), (3, H)):
        fitted = _fit(states[whole, Y], states[whole, side], objects[whole], rows)
        mean[:, column], spread[:, column], offset = fitted
        offsets.append(offset)
    aspect = _next_spread(offsets[0] - offsets[1], PRIOR_ASPECT)
    return RowProfile(profile.first_row, profile.row_step, mean, spread, aspect)


def _next_spread(offsets: NDArray[np.float64], prior: float) -> float:
    """Standard deviation of the next object's offset after those of some (n,), which average to zero."""
    n = len(offsets)
    freedom = PRIOR_OBJECTS + max(n - 1, 0)
    variance = (PRIOR_OBJECTS * prior**2 + float(offsets @ offsets)) / freedom
    return float(np.sqrt(variance * (1.0 + 1.0 / n)))


def _fit(
    y: NDArray[np.float64], size: NDArray[np.float64], objects: NDArray[np.intp], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
    """Mean log size at the rows, the spread of the next object's, and the offset of each object."""
    names, index = np.unique(objects, return_inverse=True)
    n = len(names)
    log_size, offset = np.log(size), np.zeros(n)
    weight = 1.0 / np.bincount(index)[index]  # every object counts the same, however long it was seen
    middle, level = float(weight @ y / n), float(np.exp(weight @ log_size / n))
    line = np.array([level, 0.0])
    for _ in range(_ROUNDS):
        # Least squares of relative errors; a weak pull to a flat line where all rows are alike.
        scale = weight / np.maximum(_along(line, y - middle, level), 1e-9) ** 2
        design = np.column_stack([np.ones(len(y)), y - middle])
        wanted = size * np.exp(-offset[index])
        pull = np.diag([0.0, 1e-3 * float(np.ptp(rows)) ** 2 / level**2])
        line = np.linalg.solve(design.T @ (scale[:, None] * design) + pull, design.T @ (scale * wanted))
        residual = log_size - np.log(_along(line, y - middle, level))
        offset = np.bincount(index, residual) / np.bincount(index)
        offset -= offset.mean()
    shift = float(np.mean(np.bincount(index, residual) / np.bincount(index)))
    within = float(weight @ (residual - (offset + shift)[index]) ** 2 / n)
    spread = np.hypot(_next_spread(offset, PRIOR_SPREAD), np.sqrt(within))
    return np.log(_along(line, rows - middle, level)) + shift, float(spread), offset


def _along(line: NDArray[np.float64], y: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    return np.maximum(line[0] + line[1] * y, _FLATTEST * level)
