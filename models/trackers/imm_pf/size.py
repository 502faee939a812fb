"""How large a target's box is where it stands (paper 2, section 4).

The paper projects the average size of an adult into the picture through a known camera matrix. Before
a camera that looks down on a plane the height of an upright person is close to linear in the row, so
the size can also be learned from labels:

    h = slope * (row of the centre) + offset,    w = aspect * h
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.state import H, States, W, X, Y, blank

Array = NDArray[np.float64]
_ROUNDS = 10
LEAST = 4.0
"""No box is smaller, px."""


class BoxSize(Protocol):
    """The size of a target by its centre."""

    def fill(self, states: States) -> None:
        """Set width and height of the states (n, 8) from their centres, in place."""

    def knows(self, row: float) -> bool:
        """Whether targets may be born with their centre in this row."""


@dataclass(frozen=True, slots=True)
class LinearSize:
    """Height linear in the centre's row, fixed aspect."""

    slope: float
    offset: float
    aspect: float
    """Width over height."""
    first_row: float = -np.inf
    last_row: float = np.inf
    """Rows of the centres that were learned from; nobody is born outside them."""

    def fill(self, states: States) -> None:
        """Set width and height of the states (n, 8) from their centres, in place."""
        np.maximum(self.slope * states[:, Y] + self.offset, LEAST, out=states[:, H])
        np.multiply(states[:, H], self.aspect, out=states[:, W])

    def scaled(self, factor: float) -> LinearSize:
        """The same for a picture scaled by `factor`."""
        ends = self.first_row * factor, self.last_row * factor
        return LinearSize(self.slope, self.offset * factor, self.aspect, *ends)

    def knows(self, row: float) -> bool:
        """Whether labels reached as far as this row."""
        return self.first_row <= row <= self.last_row


def learn_linear(boxes: Array) -> LinearSize:
    """A robust line through labelled boxes (n, 4): centre x, centre y, width, height.

    Least squares, repeated with the weights of Tukey's biweight (cut off at 4.685 robust standard deviations), so that
    boxes of bent or half hidden bodies do not tilt it; the aspect is the median. Raises ValueError for fewer than two
    rows.
    """
    if len(boxes) < 2 or float(np.ptp(boxes[:, 1])) < 1.0:
        raise ValueError("box sizes by row need labels in at least two rows")
    design = np.column_stack([boxes[:, 1], np.ones(len(boxes))])
    weights = np.ones(len(boxes))
    for _ in range(_ROUNDS):
        slope, offset = np.linalg.lstsq(design * weights[:, None], boxes[:, 3] * weights, rcond=None)[0]
        residual = boxes[:, 3] - slope * boxes[:, 1] - offset
        reach = 4.685 * max(1.4826 * float(np.median(np.abs(residual))), 1e-3 * float(boxes[:, 3].mean()))
        weights = np.maximum(1.0 - np.square(residual / reach), 0.0)
        if np.ptp(boxes[weights > 0.0, 1], axis=0) < 1.0:
            break
    aspect = float(np.median(boxes[:, 2] / boxes[:, 3]))
    # Half a box of the nearest and farthest label: the next one may stand a little beyond.
    first, last = (
        float(row + side * (slope * row + offset) / 2)
        for row, side in zip((boxes[:, 1].min(), boxes[:, 1].max()), (-1, 1), strict=True)
    )
    return LinearSize(float(slope), float(offset), aspect, first, last)


@dataclass(frozen=True, slots=True)
class ProfileSize:
    """The expected size of a row profile."""

    profile: RowProfile

    def fill(self, states: States) -> None:
        """Set width and height of the states (n, 8) from their centres, in place."""
        mean, _ = self.profile.at(states[:, Y])
        states[:, [W, H]] = np.maximum(np.exp(mean[:, 2:]), LEAST)

    def knows(self, row: float) -> bool:
        """Everywhere: the profile holds its ends."""
        return True


@dataclass(frozen=True, slots=True)
class CameraSize:
    """An upright body of given size on the ground plane z = 0, through a camera matrix."""

    matrix: Array
    """(3, 4): world (x, y, z, 1), z upwards, to picture (x, y, 1)."""
    height: float
    """World units, as `width`."""
    width: float

    def __post_init__(self) -> None:
        """Raises ValueError for a matrix of another shape or one that sees the plane edge on."""
        if self.matrix.shape != (3, 4):
            raise ValueError(f"a camera matrix is 3 x 4, not {self.matrix.shape}")
        if abs(np.linalg.det(self._plane())) < 1e-12:
            raise ValueError("the camera matrix does not see the ground plane")

    def _plane(self) -> Array:
        """(x, y, 1) on the plane through the middle of the bodies, to the picture (3, 3)."""
        m = self.matrix
        return np.column_stack([m[:, 0], m[:, 1], m[:, 2] * self.height / 2 + m[:, 3]])

    def fill(self, states: States) -> None:
        """Set width and height of the states (n, 8) from their centres, in place."""
        centres = np.column_stack([states[:, [X, Y]], np.ones(len(states))])
        ground = centres @ np.linalg.inv(self._plane()).T
        # Above the horizon a ray does not meet the ground; such a box has the least size.
        with np.errstate(divide="ignore", invalid="ignore"):
            ground = ground[:, :2] / ground[:, 2:]
            feet, head = self._project(ground, 0.0), self._project(ground, self.height)
            size = np.nan_to_num(np.abs(feet[:, 1] - head[:, 1]), posinf=LEAST)
        states[:, H] = np.maximum(size, LEAST)
        states[:, W] = states[:, H] * (self.width / self.height)

    def _project(self, ground: Array, z: float) -> Array:
        n = len(ground)
        seen = np.column_stack([ground, np.full(n, z), np.ones(n)]) @ self.matrix.T
        return seen[:, :2] / seen[:, 2:]

    def knows(self, row: float) -> bool:
        """Everywhere."""
        return True


def standing(size: BoxSize, x: float, bottom: float) -> Array:
    """The state (8,) at rest whose box ends at row `bottom`."""
    state = blank(1)
    state[0, X], state[0, Y] = x, bottom
    for _ in range(6):  # the size depends on the centre, and the centre on the size
        size.fill(state)
        state[0, Y] = bottom - state[0, H] / 2
    size.fill(state)
    return np.asarray(state[0])
