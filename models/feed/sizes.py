"""The trend of visible sizes, from what a net says of the bodies in a picture.

Each cell of the picture that lies on a body tells how large that body is, so sizes are weighed by the area that is seen
of them, as a sieve weighs them by mass. They are gathered over minutes, what is older counts less.

It is no sieve. Fines have no outline, and what has none is not counted; of stones that overlap the covered part is not
seen; vibration brings coarse stones to the top. All of these change little from shift to shift, so a change is one.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numpy.typing import NDArray

SMALLEST_MM, LARGEST_MM = 10.0, 3000.0
_BINS = 96


class SizeTrend:
    """Sizes in mm, weighed by area; times rise."""

    def __init__(self, memory_s: float) -> None:
        """What is `memory_s` old counts 1 / e."""
        self._memory_s = memory_s
        self._edges = np.geomspace(SMALLEST_MM, LARGEST_MM, _BINS + 1)
        self._area = np.zeros(_BINS)
        self._stones = 0.0
        self._last_s: float | None = None

    @property
    def stones(self) -> float:
        """How many measurements of whole stones are remembered."""
        return self._stones

    def add(
        self,
        sizes_mm: NDArray[np.float64],
        area: NDArray[np.float64],
        shares: NDArray[np.float64],
        time_s: float,
    ) -> None:
        """Cells (n,) of one picture: the size of the body that each lies on, the ground that it shows, and its share
        of that body.
        """
        if self._last_s is not None:
            kept = exp(-max(time_s - self._last_s, 0.0) / self._memory_s)
            self._area *= kept
            self._stones *= kept
        self._last_s = time_s
        fits = (sizes_mm >= SMALLEST_MM) & (sizes_mm <= LARGEST_MM)
        self._area += np.histogram(sizes_mm[fits], self._edges, weights=area[fits])[0]
        self._stones += float(shares[fits].sum())

    def quantile(self, share: float) -> float | None:
        """Size that this share of the area lies below, mm; None where nothing was seen."""
        total = float(self._area.sum())
        if not total > 0.0:
            return None
        below = np.concatenate([[0.0], np.cumsum(self._area)]) / total
        return float(np.exp(np.interp(share, below, np.log(self._edges))))
