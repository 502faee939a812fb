"""Where targets are born: regions of foreground that no target explains (paper 2, section 5.3).

The boxes of the targets, somewhat enlarged, are taken out of the foreground; each region that is left
and has a plausible size for its row bears a target, with its feet on the region's lowest row. A region
as wide as several boxes bears as many, side by side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.state import H, W, X, Y
from lumpwatch.models.trackers.foreground import regions
from lumpwatch.models.trackers.imm_pf.observation import STEP, PictureGrids, paint
from lumpwatch.models.trackers.imm_pf.options import TrackerOptions
from lumpwatch.models.trackers.imm_pf.size import BoxSize, standing

Array = NDArray[np.float64]
_LEAST_AREA = 20
"""Pixels of the grid."""


def candidates(
    seen: PictureGrids, targets: Sequence[Array], size: BoxSize, o: TrackerOptions
) -> Iterator[Array]:
    """States (8,) of new targets, given those (8,) that there are."""
    rest = seen.foreground.copy()
    for target in targets:
        paint(rest, target, o.explained, 0)
    for x, y, w, h in regions(rest, _LEAST_AREA) * STEP:
        bottom = y + h / 2
        expected = standing(size, x, bottom)
        if h < o.birth_height * expected[H] or w < o.birth_width * expected[W]:
            continue
        parts = max(1, round(w / (1.1 * expected[W]))) if w > o.split_width * expected[W] else 1
        for k in range(parts):
            part = standing(size, x + w * ((k + 0.5) / parts - 0.5), bottom)
            whole = not outside(part, seen.shape, o.edge) and size.knows(float(part[Y]))
            if whole and _fill(rest, part) >= o.birth_fill:
                yield part


def outside(state: Array, shape: tuple[int, int], share: float) -> bool:
    """Whether more than `share` of a side of the box lies beyond an edge of the picture (h, w)."""
    rows, columns = shape
    left, top = state[X] - state[W] / 2, state[Y] - state[H] / 2
    right, bottom = left + state[W], top + state[H]
    return bool(max(-left, right - columns) > share * state[W] or max(-top, bottom - rows) > share * state[H])


def _fill(foreground: NDArray[np.uint8], state: Array) -> float:
    """Share of foreground in a box."""
    x, w, y, h = (state[i] / STEP for i in (X, W, Y, H))
    part = foreground[max(int(y - h / 2), 0) : int(y + h / 2), max(int(x - w / 2), 0) : int(x + w / 2)]
    return float(part.mean()) if part.size else 0.0
