"""The learned motion prior (paper 2, section 5.1, after its reference [9]).

The picture is divided into cells. For each cell the velocities of everything that moved there are
gathered, from optical flow, as a histogram over a square grid of velocities; a particle samples its
velocity from the histogram of its cell. A cell with too little data falls back on the particle's own
velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.models.state import VX, VY, States, X, Y

VELOCITY_BINS = 15
LEAST_SAMPLES = 10
"""A cell with fewer vectors falls back."""
_MOST_CORNERS = 400


@dataclass(frozen=True, slots=True)
class CellVelocities:
    """Velocity histograms of all cells."""

    cell: float
    """Side of a cell."""
    fastest: float
    """Velocities run from minus to plus this along each axis."""
    counts: NDArray[np.float64]
    """(rows, columns, 15, 15): vectors by cell, velocity along y and along x."""

    def scaled(self, factor: float) -> CellVelocities:
        """The histograms for a picture scaled by `factor`."""
        return CellVelocities(self.cell * factor, self.fastest * factor, self.counts)

    def cell_of(self, states: States) -> NDArray[np.intp]:
        """Flat index of each state's cell (n,); positions outside belong to the nearest cell."""
        rows, columns = self.counts.shape[:2]
        row = np.clip((states[:, Y] / self.cell).astype(np.intp), 0, rows - 1)
        column = np.clip((states[:, X] / self.cell).astype(np.intp), 0, columns - 1)
        return row * columns + column

    def known(self, states: States) -> NDArray[np.bool_]:
        """Whether each state's cell has data enough (n,)."""
        totals = self.counts.sum(axis=(2, 3)).ravel()
        return totals[self.cell_of(states)] >= LEAST_SAMPLES


def learn_cells(
    positions: NDArray[np.float64],
    velocities: NDArray[np.float64],
    shape: tuple[int, int],
    cell: float = 30.0,
) -> CellVelocities:
    """Histograms from flow vectors: positions and velocities (k, 2) in a picture of `shape` (h, w).

    The grid of velocities reaches to the 99.5th percentile of the speeds. Raises ValueError without
    vectors.
    """
    if len(positions) == 0:
        raise ValueError("no optical flow to learn a motion prior from")
    fastest = max(float(np.percentile(np.abs(velocities), 99.5)), 1e-6)
    rows, columns = (int(np.ceil(side / cell)) for side in shape)
    bins = np.clip(((velocities / fastest + 1.0) / 2.0 * VELOCITY_BINS).astype(int), 0, VELOCITY_BINS - 1)
    row = np.clip((positions[:, 1] / cell).astype(int), 0, rows - 1)
    column = np.clip((positions[:, 0] / cell).astype(int), 0, columns - 1)
    counts = np.zeros((rows, columns, VELOCITY_BINS, VELOCITY_BINS))
    np.add.at(counts, (row, column, bins[:, 1], bins[:, 0]), 1.0)
    return CellVelocities(cell, fastest, counts)


def flow_vectors(
    before: Image, after: Image, interval_s: float, mask: Image | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and velocities (k, 2) of corners that pyramidal Lucas-Kanade follows from one picture to the next.

    Corners are followed back as well; those that do not return to within a pixel are dropped. Where a
    mask of the first picture is given, corners are looked for where it is not 0.
    """
    nothing = np.empty((0, 2))
    corners = cv2.goodFeaturesToTrack(before, _MOST_CORNERS, 0.01, 5, mask=mask)
    if corners is None:
        return nothing, nothing  # type: ignore[unreachable]
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None)  # type: ignore[call-overload]
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, moved, None)  # type: ignore[call-overload]
    start, end = corners.reshape(-1, 2).astype(float), moved.reshape(-1, 2).astype(float)
    error = np.hypot(*(back.reshape(-1, 2) - start).T)
    good = (found.ravel() == 1) & (found_back.ravel() == 1) & (error < 1.0)
    return start[good], (end[good] - start[good]) / interval_s


@dataclass(frozen=True, slots=True)
class MotionPrior:
    """Velocities sampled from the particle's cell; satisfies `MotionModel`."""

    name: str
    cells: CellVelocities
    velocity_noise: float
    """px/s gathered in one second, where a cell falls back on the particle's own velocity."""
    momentary: bool = False
    _cumulative: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Sum the histograms up once."""
        flat = self.cells.counts.reshape(-1, VELOCITY_BINS**2)
        object.__setattr__(self, "_cumulative", np.cumsum(flat, axis=1))

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        """Draw a velocity from the cell and move by it; where the cell is not `known`, by the own velocity."""
        moved = states.copy()
        n = len(states)
        mine = self.cells.cell_of(states)
        totals = self._cumulative[mine, -1]
        chosen = _pick(self._cumulative, mine, rng.random(n) * totals)
        within = rng.random((n, 2))
        width = 2.0 * self.cells.fastest / VELOCITY_BINS
        drawn = -self.cells.fastest + width * (
            np.column_stack([chosen % VELOCITY_BINS, chosen // VELOCITY_BINS]) + within
        )
        own = states[:, VX : VY + 1] + self.velocity_noise * np.sqrt(dt) * rng.standard_normal((n, 2))
        velocity = np.where((totals >= LEAST_SAMPLES)[:, None], drawn, own)
        moved[:, X : Y + 1] += velocity * dt
        moved[:, VX : VY + 1] = velocity
        moved[:, 4:6] = 0.0
        return moved


@njit(cache=True)
def _pick(cumulative, rows, places):  # type: ignore[no-untyped-def]
    """The first column of each row whose sum passes the place."""
    chosen = np.empty(len(rows), np.intp)
    for i in range(len(rows)):
        chosen[i] = np.searchsorted(cumulative[rows[i]], places[i], side="right")
    return chosen
