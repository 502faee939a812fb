"""The motion model prediction function P(alpha_t | x_{t-1}, alpha_{t-1}) (paper 1, section 2.2.2).

Fixed (Eq. 10): the row of a transition matrix. Adaptive (Eq. 12): each entry of the row is weighed by
the density p(x_{t-1} | alpha_t) of the place where the object is, and the row is normalised again.
Far from all training data every density vanishes and Eq. 12 would divide by zero: there the row of
the matrix is used as it is (Eq. 10), and the share of such particles is reported.

The matrix is learned for one frame interval. For another interval a regime keeps its rate of
switching per second, while a momentary model (a bounce) still lasts exactly one step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import check_shape, settle
from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.state import Labels, States

Matrix = NDArray[np.float64]
_FLOOR = 1e-6
"""Densities below this share of their highest value count as 'no data here'."""


class Switching(Protocol):
    """Draws the next motion model of each particle."""

    def rows(self, states: States, labels: Labels, dt: float) -> tuple[Matrix, NDArray[np.bool_]]:
        """P(alpha_t | x_{t-1}, alpha_{t-1}) as (n, M), and where the fall-back on Eq. 10 was used (n,)."""


def check_matrix(matrix: Matrix) -> Matrix:
    """A square matrix whose rows are probabilities; raises ValueError otherwise."""
    matrix = np.asarray(matrix, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"a transition matrix is square, not {matrix.shape}")
    if not np.all(matrix >= 0) or not np.allclose(matrix.sum(axis=1), 1.0, atol=1e-9):
        raise ValueError(
            f"the rows of a transition matrix are probabilities that sum to 1, not to {matrix.sum(axis=1)}"
        )
    return matrix


def over_interval(matrix: Matrix, steps: float, momentary: NDArray[np.bool_]) -> Matrix:
    """The matrix for `steps` learned intervals (any positive number, 1 gives the matrix itself).

    Whole intervals multiply; the rest is interpolated between staying and one transition, which
    keeps every row a probability. Rows of momentary models are used as learned.
    """
    if abs(steps - 1.0) < 1e-6:
        return matrix
    whole = int(steps)
    scaled = (steps - whole) * matrix
    scaled.flat[:: len(matrix) + 1] += 1.0 - (steps - whole)
    if whole:
        scaled = np.linalg.matrix_power(matrix, whole) @ scaled
    scaled[momentary] = matrix[momentary]
    return scaled


def joint_probabilities(
    previous: Labels, following: Labels, models: int, pseudo_count: float = 0.1
) -> Matrix:
    """P(alpha_{t-1}, alpha_t) as relative frequency of the pairs (Eq. 13).

    `pseudo_count` is spread evenly over each row before normalising, so that a pair that the
    training never showed stays possible; 0 keeps empty cells at 0 as in the paper's Table 1.
    Raises ValueError where there is neither a pair nor a pseudo-count.
    """
    counts = np.full((models, models), pseudo_count / models)
    np.add.at(counts, (previous, following), 1.0)
    if counts.sum() <= 0:
        raise ValueError("no pairs of labels to learn transitions from")
    return counts / counts.sum()


def conditional(joint: Matrix) -> Matrix:
    """P(alpha_t | alpha_{t-1}) from the joint probabilities; a model never left stays itself (Eq. 11)."""
    totals = joint.sum(axis=1, keepdims=True)
    return np.where(totals > 0, joint / np.where(totals > 0, totals, 1.0), np.eye(len(joint)))


def _checked(
    matrix: Matrix, interval_s: float, momentary: NDArray[np.bool_]
) -> dict[str, NDArray[np.float64] | NDArray[np.bool_]]:
    """Matrix and momentary models as arrays that fit each other."""
    matrix, flags = check_matrix(matrix), np.asarray(momentary)
    check_shape(flags, (len(matrix),), "momentary")
    if flags.dtype != np.bool_:
        raise ValueError(f"momentary must be true or false for each model, not of {flags.dtype}")
    if not 0.0 < interval_s < float("inf"):
        raise ValueError(f"interval_s must be positive and finite, not {interval_s}")
    return {"matrix": matrix, "momentary": flags}


@dataclass(frozen=True, slots=True)
class FixedSwitching:
    """Eq. 10 and 11: the next model depends on the last one only."""

    matrix: Matrix
    interval_s: float
    """Frame interval for which the matrix holds."""
    momentary: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Raises ValueError where a row of the matrix is no probability, or `momentary` is of another length."""
        settle(self, _checked(self.matrix, self.interval_s, self.momentary))

    def rows(self, states: States, labels: Labels, dt: float) -> tuple[Matrix, NDArray[np.bool_]]:
        """The matrix row of each particle's label."""
        matrix = over_interval(self.matrix, dt / self.interval_s, self.momentary)
        return matrix[labels], np.zeros(len(states), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class AdaptiveSwitching:
    """Eq. 12: the next model depends on the last one and on where the object is."""

    matrix: Matrix
    interval_s: float
    """Frame interval for which the matrix holds."""
    momentary: NDArray[np.bool_]
    density: GridDensity

    def __post_init__(self) -> None:
        """Raises ValueError where a row of the matrix is no probability (a joint one has to be divided).

        Also where `momentary` or `density` is of another number of models.
        """
        settle(self, _checked(self.matrix, self.interval_s, self.momentary))
        if len(self.density.values) != len(self.matrix):
            raise ValueError(
                f"density must be of the {len(self.matrix)} models of the matrix, not of {len(self.density.values)}"
            )

    def rows(self, states: States, labels: Labels, dt: float) -> tuple[Matrix, NDArray[np.bool_]]:
        """Eq. 12 for each particle, Eq. 10 where no training state is near.

        P(alpha_{t-1}, alpha_t) may stand as the conditional probability: the factor
        P(alpha_{t-1}) cancels between numerator and denominator.
        """
        matrix = over_interval(self.matrix, dt / self.interval_s, self.momentary)
        densities = self.density.at(states)
        floor = _FLOOR * float(self.density.values.max())
        return _bayes_rows(densities, matrix, labels, floor)


def draw(rows: Matrix, rng: np.random.Generator) -> Labels:
    """One label for each row of probabilities (n, M), by inversion of the cumulative sum.

    Raises ValueError for a row that holds no probability.
    """
    labels = _invert(rows, rng.random(len(rows)))
    if len(labels) and labels.min() < 0:
        raise ValueError("a row of probabilities is zero or not a number everywhere")
    return labels


@njit(cache=True)
def _bayes_rows(densities, matrix, labels, floor):  # type: ignore[no-untyped-def]
    n, models = densities.shape
    rows = np.empty((n, models))
    fell_back = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        total, near = 0.0, 0.0
        for m in range(models):
            rows[i, m] = densities[i, m] * matrix[labels[i], m]
            total += rows[i, m]
            near = max(near, densities[i, m])
        # Data may be near while every model reachable from this label is absent there: same remedy.
        if near < floor or total <= 0.0:
            fell_back[i] = True
            for m in range(models):
                rows[i, m] = matrix[labels[i], m]
        else:
            for m in range(models):
                rows[i, m] /= total
    return rows, fell_back


@njit(cache=True)
def _invert(rows, u):  # type: ignore[no-untyped-def]
    n, models = rows.shape
    labels = np.empty(n, dtype=np.intp)
    for i in range(n):
        c, k = 0.0, -1
        for m in range(models):
            c += rows[i, m]
            if rows[i, m] > 0.0:
                k = m
                if u[i] < c:
                    break
        labels[i] = k
    return labels
