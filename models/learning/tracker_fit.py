"""What training learns for a tracker of many objects, beside the motion of a filter of one.

Each motion model's noise is what it leaves unexplained of labelled tracks, by the median absolute deviation: labels
drawn by hand jump now and then. A model of standing objects is judged by those that stand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.tracks import Samples
from lumpwatch.models.state import AX, AY, VX, VY, H, W, X, Y
from lumpwatch.models.trackers.imm_pf import LinearSize, learn_linear
from lumpwatch.models.trackers.scene import EmptyScene

Array = NDArray[np.float64]
LEAST_POSITION_H = 0.01
LEAST_VELOCITY_H_S = 0.05
LEAST_ACCELERATION_H_S2 = 0.09
"""Floors of the noise, in ROI heights: smoothed labels say less than the filter has to follow. Chosen on the first half
of PETS 2009 S2.L1, view 1."""
_STANDING = 0.2
"""What is slower than this share of the fast ones (95th percentile) stands."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations that gather in one second, in ROI heights."""

    position: float = LEAST_POSITION_H
    velocity: float = LEAST_VELOCITY_H_S
    acceleration: float = LEAST_ACCELERATION_H_S2

    def times(self, factor: float) -> Noise:
        """All of them larger by a factor."""
        return Noise(factor * self.position, factor * self.velocity, factor * self.acceleration)


@dataclass(frozen=True, slots=True)
class ForegroundChoice:
    """The background model that fitted the training clip best."""

    kind: Literal["mixture", "statistical"]
    threshold: float = 0.0
    """Of the mixture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerFit:
    """What a tracker knows of its region."""

    noise: Noise = Noise()
    size: LinearSize | None = None
    """Height of a box by its row and width by its height, in ROI heights; None: the row profile."""
    scene: EmptyScene | None = None
    """The region without anything that moves; None: learned from the first pictures."""
    foreground: ForegroundChoice | None = None
    """None: the configured or default one."""
    working_size_px: int | None = None
    """None: the configured or default one."""


def fit_noise(steps: Samples, height: float) -> Noise:
    """The noise of standing, constant velocity and free acceleration in labelled steps; `height` is the ROI's, px."""
    root = np.sqrt(steps.interval_s)
    before, after = steps.states, steps.velocity
    speed = np.hypot(*after.T)
    standing = after[speed <= _STANDING * np.percentile(speed, 95)] * steps.interval_s
    turn = after - before[:, [VX, VY]]
    same = ~steps.starts[1:]
    jerk = (before[1:, [AX, AY]] - before[:-1, [AX, AY]])[same]
    return Noise(
        max(_robust(standing) / root / height, LEAST_POSITION_H),
        max(_robust(turn) / root / height, LEAST_VELOCITY_H_S),
        max(_robust(jerk) / root / height, LEAST_ACCELERATION_H_S2),
    )


def fit_size(steps: Samples, height: float) -> LinearSize | None:
    """Box sizes by row; None where the labels lie in one row."""
    try:
        return learn_linear(steps.states[:, [X, Y, W, H]]).scaled(1.0 / height)
    except ValueError:
        return None


def _robust(values: Array) -> float:
    """Standard deviation of values (n, 2) by the median absolute deviation; 0 for none."""
    return float(1.4826 * np.median(np.abs(values))) if len(values) else 0.0
