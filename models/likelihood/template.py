"""A lump's template: contrasts of a grid of cells over a box and what lies around it.

The box and its surroundings, `SPAN` times as large, are cut into `CELLS` x `CELLS` cells. Four channels tell
of each how bright it is, how rough, how rough at the coarse scale, and which way its edges run; so the weights
of a linear score are a picture of a lump: smooth within, an edge along the outline, level edges above and
below, upright ones at the sides, rubble around (integral channel features: Dollár, Tu, Perona, Belongie 2009).
A lump may as well be mirrored, so each cell is taken together with its mirror image: half as many numbers
for a handful of labelled lumps to teach.

Roughness is told as (a - b) / (a + b), with the mean of the surroundings for b: bounded, without a logarithm,
and the same under a change of light.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lumpwatch.models.likelihood.base import box_edges
from lumpwatch.models.likelihood.sums import coarse_of, sums_of, unpacked

CELLS, SPAN = 5, 1.6
CHANNELS = ("brightness", "texture", "coarse_texture", "upright_edges")
COLUMNS = (CELLS + 1) // 2
"""Of cells, from the outermost to the middle one: the others are their mirror images."""
NAMES = tuple(
    f"{channel} {row}{column}" for row in range(CELLS) for column in range(COLUMNS) for channel in CHANNELS
)
"""What `contrasts` measures, in order: channel, row from the top and column from the side."""
NOISE = 2.0  # grey levels; keeps ratios of flat patches finite
_AROUND = 1.5
_CHANNELS, _GRID, _LINES = len(CHANNELS), CELLS * CELLS, CELLS + 1


@njit(cache=True, error_model="numpy")
def scratch():  # type: ignore[no-untyped-def]
    """Memory for `contrasts`: of no use outside it."""
    return np.empty((5, _GRID)), np.empty(_LINES, np.uint64), np.empty((3, _LINES), np.int64)


@njit(cache=True, error_model="numpy")
def contrasts(sums, inside, state, memory, out):  # type: ignore[no-untyped-def]
    """Write the contrasts (60,) of one state's box; zero where no part of a cell lies in the polygon."""
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    around = box_edges(state, _AROUND, width, height)
    light, square, rough, pixels = sums_of(sums, inside, around)
    per_pixel = 1.0 / max(pixels, 1.0)
    light, rough, coarse = light * per_pixel, rough * per_pixel, coarse_of(sums, around) * per_pixel
    per_spread = 1.0 / (np.sqrt(max(square * per_pixel - light * light, 0.0)) + NOISE)
    cells, lines, nodes = memory
    _gather(sums, inside, state, cells, lines, nodes)
    area, bright, texture, blurred, upright = cells[0], cells[1], cells[2], cells[3], cells[4]
    for i in range(_GRID):
        per_area = 1.0 / max(area[i], 1.0)
        gradient, blur = texture[i] * per_area, blurred[i] * per_area
        upright[i] = (2.0 * upright[i] * per_area - gradient) / (gradient + 2.0 * NOISE)
        bright[i] = (bright[i] * per_area - light) * per_spread
        texture[i] = (gradient - rough) / (gradient + rough + 2.0 * NOISE)
        blurred[i] = (blur - coarse) / (blur + coarse + 2.0 * NOISE)
    for row in range(CELLS):
        for column in range(COLUMNS):
            one, other = row * CELLS + column, row * CELLS + CELLS - 1 - column
            first, second = (0.5 if area[one] > 0.0 else 0.0), (0.5 if area[other] > 0.0 else 0.0)
            if first != second:
                first, second = 2.0 * first, 2.0 * second
            k = _CHANNELS * (row * COLUMNS + column)
            for channel in range(_CHANNELS):
                out[k + channel] = first * cells[1 + channel, one] + second * cells[1 + channel, other]


@njit(cache=True, error_model="numpy")
def _gather(sums, inside, state, cells, lines, nodes):  # type: ignore[no-untyped-def]
    """Area, brightness, gradient, coarse gradient and |dx| of each cell, as rows of `cells`."""
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    for column in range(_LINES):
        lines[column] = _line(state[0], state[6], column, width)
    for row in range(_LINES):
        y = np.uint64(_line(state[1], state[7], row, height))
        last_area, last_first, last_third = np.int64(0), np.int64(0), np.int64(0)
        for column in range(_LINES):
            x = lines[column]
            # Differences to the row of nodes above, then to the node on the left.
            area = np.int64(inside[y, x])
            first, third = np.int64(sums[y, x, 0]), np.int64(sums[y, x, 2])
            column_area = area - nodes[0, column]
            column_first, column_third = first - nodes[1, column], third - nodes[2, column]
            nodes[0, column], nodes[1, column], nodes[2, column] = area, first, third
            if row > 0 and column > 0:
                i = (row - 1) * CELLS + column - 1
                cells[0, i] = column_area - last_area
                cells[1, i], cells[2, i], cells[4, i], cells[3, i] = unpacked(
                    column_first - last_first, column_third - last_third
                )
            last_area, last_first, last_third = column_area, column_first, column_third


@njit(cache=True, error_model="numpy")
def _line(centre, size, number, most):  # type: ignore[no-untyped-def]
    """The `number`th of the grid's lines, as a whole pixel inside the picture."""
    place = int(np.floor(centre + (number / CELLS - 0.5) * SPAN * size + 0.5))
    return min(max(place, 0), most)
