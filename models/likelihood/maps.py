"""What is kept of the net's maps to look boxes up in: integral images, and what each cell says of its body.

The integral images hold, of each cell as far as it lies in the polygon: its share of it, body, edge, and the log
size of what is there, that of its body or of ore. Beside them stand the probability of a body and the places of the
body's four sides, cell by cell, for a box to ask a few of its cells.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.likelihood.net import REACH, STRIDE

SUMS = 4
AREA, BODY, EDGE, SIZE = range(SUMS)
"""What is summed, in order."""
VOTES = 5
PROBABILITY, LEFT, UPPER, RIGHT, LOWER = range(VOTES)
"""What a cell says of its body: whether there is one, and its box, px."""
GRAIN_PX = 6.0
"""Size that ore counts with, where no body is."""
_LARGEST = 7.0
"""Of a side's logarithm: a thousand pixels; no body is that large."""


def cell_shares(inside: NDArray[np.int32]) -> NDArray[np.float32]:
    """The share of each cell that lies in the polygon, from its integral image (h + 1, w + 1)."""
    h, w = inside.shape[0] - 1, inside.shape[1] - 1
    rows = np.minimum(np.arange(0, h + STRIDE, STRIDE), h)
    columns = np.minimum(np.arange(0, w + STRIDE, STRIDE), w)
    nodes = inside[np.ix_(rows, columns)]
    area = np.diff(np.diff(nodes, axis=0), axis=1)
    return area.astype(np.float32) / np.float32(STRIDE * STRIDE)


@njit(cache=True, error_model="numpy")
def prepare(maps, shares, sums, votes):  # type: ignore[no-untyped-def]
    """Write integral images (rows + 1, columns + 1, SUMS) and votes (rows, columns, VOTES) of maps (6, rows, columns).

    Maps are in the order of `HEADS`, `shares` (rows, columns) as of `cell_shares`. A cell outside the polygon has no
    body.
    """
    rows, columns = shares.shape
    grain = np.log(GRAIN_PX)
    for y in range(rows):
        area, bodies, edges, sizes = 0.0, 0.0, 0.0, 0.0
        for x in range(columns):
            share = np.float64(shares[y, x])
            if share > 0.0:
                body = share / (1.0 + np.exp(-np.float64(maps[0, y, x])))
                centre_x, centre_y = STRIDE * (x + 0.5), STRIDE * (y + 0.5)
                left = np.exp(min(np.float64(maps[2, y, x]), _LARGEST)) - REACH
                upper = np.exp(min(np.float64(maps[3, y, x]), _LARGEST)) - REACH
                right = np.exp(min(np.float64(maps[4, y, x]), _LARGEST)) - REACH
                lower = np.exp(min(np.float64(maps[5, y, x]), _LARGEST)) - REACH
                votes[y, x, 0] = body
                votes[y, x, 1] = centre_x - left
                votes[y, x, 2] = centre_y - upper
                votes[y, x, 3] = centre_x + right
                votes[y, x, 4] = centre_y + lower
                size = 0.5 * np.log(max(left + right, 1.0) * max(upper + lower, 1.0))
                area += share
                bodies += body
                edges += share / (1.0 + np.exp(-np.float64(maps[1, y, x])))
                sizes += body * size + (share - body) * grain
            else:
                votes[y, x, :] = 0.0
            sums[y + 1, x + 1, 0] = sums[y, x + 1, 0] + area
            sums[y + 1, x + 1, 1] = sums[y, x + 1, 1] + bodies
            sums[y + 1, x + 1, 2] = sums[y, x + 1, 2] + edges
            sums[y + 1, x + 1, 3] = sums[y, x + 1, 3] + sizes
