"""A labelled lump cut from footage, to be shown again by proof tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MARGIN = 0.2
"""Of the cut around the labelled box, on each side, in sides of the box: its outline has to come along."""
LARGEST_PX = 192
"""Longer side of a cut."""
_LEAST_SPREAD = 8.0


@dataclass(frozen=True, slots=True)
class LumpCut:
    """One lump as it looked."""

    name: str
    """Which one, for people."""
    picture: NDArray[np.uint8]
    """Luma of the labelled box with `MARGIN` around it (h, w)."""
    box: tuple[float, float, float, float]
    """Centre and size of the labelled box in the region, ROI heights."""
    tone: tuple[float, float]
    """Mean and spread of the region's luma then."""


def tone_of(luma: NDArray[np.uint8]) -> tuple[float, float]:
    """Mean and standard deviation of a part of the picture, the latter at least 8 grey levels."""
    return float(luma.mean()), max(float(luma.std()), _LEAST_SPREAD)
