"""What training finds out about one region: the content of a prior.

Lengths are in ROI heights, so that a prior holds for any working size of the same region.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.motion_prior import CellVelocities
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning.tracker_fit import TrackerFit
from lumpwatch.models.likelihood.histogram import Channel
from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns

DEFAULT_LOOKS_PER_S = 12.0
"""Where nothing was learned: all of each frame counts at 12 frames a second, half of it at 24."""

DEFAULT_MARGIN = 0.5
"""Where nothing was learned. Training looks at minutes, a filter at months: in hours of ore there are stones that look
more like a lump than any that training saw, and one of them lies there for as long as a lump would."""


DEFAULT_SHARE = 0.5
"""Of the evidence of a histogram, where nothing was learned."""


@dataclass(frozen=True, slots=True)
class LumpFit:
    """Fitted numbers of the lump likelihood; see `LumpLikelihood`."""

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    weights: NDArray[np.float64]
    offset: float
    looks_per_s: float = DEFAULT_LOOKS_PER_S
    """How many independent looks a second of frames is worth: neighbouring frames repeat each other."""
    patterns: Patterns = field(default_factory=lambda: no_patterns(len(FEATURES)))
    margin: float = DEFAULT_MARGIN
    """How far the score of a box must lie above even odds before it speaks for a lump."""
    net: str = ""
    """Name of the net whose maps it scores."""


@dataclass(frozen=True, slots=True)
class HistogramFit:
    """Fitted numbers of the histogram likelihood; see `HistogramLikelihood`."""

    reference: NDArray[np.float64]
    offset: float
    slope: float
    channel: Channel
    evidence: float = DEFAULT_SHARE
    """Share of a frame's log likelihood ratio that counts."""


@dataclass(frozen=True, slots=True)
class Learned:
    """Everything that training learned for one region."""

    models: tuple[str, ...]
    """Names of the motion models, in the order of all arrays below."""
    rates: NDArray[np.float64]
    """Acceleration of each model, ROI heights / s^2 (M, 2)."""
    velocity_noise: NDArray[np.float64]
    """Spread of the velocity that gathers in one second, ROI heights / s (M,)."""
    joint: NDArray[np.float64]
    """P(alpha_{t-1}, alpha_t), Eq. 13 (M, M)."""
    interval_s: float
    """Frame interval for which `joint` holds."""
    density: GridDensity
    """p(x_{t-1} | alpha_t), Eq. 14, over lengths in ROI heights."""
    births: NDArray[np.float64]
    """P_b(alpha) (M,)."""
    profile: RowProfile
    """Velocity and size by row, in ROI heights."""
    likelihood: LumpFit | HistogramFit
    label_counts: NDArray[np.int64]
    """Training steps of each model (M,)."""
    tracks: int
    """Labelled objects that were used."""
    birth_places: NDArray[np.float64] | None = None
    """Where labelled objects were in their first moments, ROI heights (k, 2)."""
    cells: CellVelocities | None = None
    """Velocities by place, where a motion prior is among the models; lengths in ROI heights."""
    tracker: TrackerFit | None = None
    """What a tracker of many objects learned besides; None for a filter of lumps."""
