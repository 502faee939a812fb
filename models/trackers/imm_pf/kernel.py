"""Kernels of the observation: colour bins, histograms and silhouettes of boxes, on the grid of a picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from lumpwatch.models.roi import Image

HUES, SATURATIONS, VALUES = 10, 8, 10
COLOURS = HUES * SATURATIONS + VALUES
MOTIONS = 8
_COLOURED = 26
"""Saturation and brightness from which a pixel has a colour."""
_SEEN_LEAST = 0.15
"""The colours of a box visible by less than this share say nothing."""


class Grids(NamedTuple):
    """What is known of each pixel of the grid (h, w)."""

    colour: Image
    motion: Image
    foreground: Image
    covered: Image
    """1 under nearer targets."""
    claimed: Image
    """How many other targets are expected there."""


class Factors(NamedTuple):
    """`ObservationOptions` as kernels take them."""

    colour: float
    motion: float
    silhouette: float
    band: float
    core: float
    neutral: float
    claim: float
    foreground_only: bool


@njit(cache=True)
def colour_bins(hsv):  # type: ignore[no-untyped-def]
    """The colour bin of each pixel (h, w) of a picture in hue, saturation and value (h, w, 3)."""
    h, w, _ = hsv.shape
    bins = np.empty((h, w), np.uint8)
    for i in range(h):
        for j in range(w):
            hue, saturation, value = hsv[i, j, 0], hsv[i, j, 1], hsv[i, j, 2]
            if saturation < _COLOURED or value < _COLOURED:
                bins[i, j] = HUES * SATURATIONS + value * VALUES // 256
            else:
                bins[i, j] = hue * HUES // 180 * SATURATIONS + saturation * SATURATIONS // 256
    return bins


@njit(cache=True)
def count_colours(grids, box, factors, out):  # type: ignore[no-untyped-def]
    """Count the visible pixels of the core of a box (4,) into rows upper, lower, motion; give their numbers."""
    colour, motion, foreground, covered, _ = grids
    rows, columns = colour.shape
    x, y, w, h = box
    core, only = factors.core, factors.foreground_only
    left, right = max(int(x - 0.5 * core * w + 0.5), 0), min(int(x + 0.5 * core * w + 0.5), columns)
    top, bottom = max(int(y - 0.5 * core * h + 0.5), 0), min(int(y + 0.5 * core * h + 0.5), rows)
    middle = int(y + 0.5)
    upper = lower = 0
    for i in range(top, bottom):
        half = 0 if i < middle else 1
        for j in range(left, right):
            if covered[i, j] or (only and not foreground[i, j]):
                continue
            out[half, colour[i, j]] += 1
            out[2, motion[i, j]] += 1
            if half == 0:
                upper += 1
            else:
                lower += 1
    return upper, lower


@njit(cache=True)
def observe_boxes(grids, boxes, roots, table, usual, factors):  # type: ignore[no-untyped-def]
    """Cost, appearance cost, inside, ring and visible share (5, n) of boxes by centre and size, each (n,)."""
    _, _, foreground, covered, claimed = grids
    x, y, w, h = boxes
    band, neutral, claim = factors.band, factors.neutral, factors.claim
    n = len(x)
    rows, columns = foreground.shape
    out = np.zeros((5, n))
    # Integrals of the visible and of the foreground pixels over the window that holds all boxes.
    reach_x, reach_y = 0.5 * w.max() * (1.0 + 2.0 * band) + 2.0, 0.5 * h.max() + band * w.max() + 2.0
    x0, x1 = min(max(int(x.min() - reach_x), 0), columns), max(min(int(x.max() + reach_x) + 1, columns), 0)
    y0, y1 = min(max(int(y.min() - reach_y), 0), rows), max(min(int(y.max() + reach_y) + 1, rows), 0)
    x1, y1 = max(x1, x0), max(y1, y0)
    hid = np.zeros((y1 - y0 + 1, x1 - x0 + 1))
    full = np.zeros((y1 - y0 + 1, x1 - x0 + 1))
    for i in range(y1 - y0):
        sum_hid = sum_full = 0.0
        for j in range(x1 - x0):
            if covered[y0 + i, x0 + j]:
                sum_hid += 1
                sum_full += neutral
            elif claimed[y0 + i, x0 + j]:
                sum_full += (1.0 - claim) * foreground[y0 + i, x0 + j] + claim * neutral
            else:
                sum_full += foreground[y0 + i, x0 + j]
            hid[i + 1, j + 1] = hid[i, j + 1] + sum_hid
            full[i + 1, j + 1] = full[i, j + 1] + sum_full
    counts = np.zeros((3, roots.shape[1]), np.int64)
    for k in range(n):
        width, height = w[k], h[k]
        area = max(width * height, 1.0)
        a, b = _sums(hid, full, x[k] - x0, y[k] - y0, width, height)
        wide, tall = width * (1.0 + 2.0 * band), height + 2.0 * band * width
        aa, bb = _sums(hid, full, x[k] - x0, y[k] - y0, wide, tall)
        visible = min(max(1.0 - a / area, 0.0), 1.0)
        inside = min(b / area, 1.0)
        ring = max(bb - b - neutral * (aa - a), 0.0) / (wide * tall - width * height)
        out[4, k], out[2, k], out[3, k] = visible, inside, ring
        appearance = usual
        if visible >= _SEEN_LEAST:
            counts[:] = 0
            upper, lower = count_colours(grids, (x[k], y[k], width, height), factors, counts)
            distance = _distance(counts[0], roots[0], table, upper) + _distance(
                counts[1], roots[1], table, lower
            )
            moved = _distance(counts[2, :MOTIONS], roots[2], table, upper + lower)
            out[1, k] = factors.colour * distance + factors.motion * moved
            appearance = visible * out[1, k] + (1.0 - visible) * usual
        out[0, k] = appearance + factors.silhouette * (1.0 - inside + ring)
    return out


@njit(cache=True)
def _distance(counts, roots, table, total):  # type: ignore[no-untyped-def]
    """Squared Bhattacharyya distance of counts to a reference; nothing counted is half a distance."""
    if total == 0:
        return 1.0
    overlap = 0.0
    for i in range(len(counts)):
        if counts[i] > 0:
            overlap += table[min(counts[i], len(table) - 1)] * roots[i]
    return max(1.0 - overlap / np.sqrt(total), 0.0)


@njit(cache=True)
def _edges(centre, length, size):  # type: ignore[no-untyped-def]
    low, high = centre - 0.5 * length, centre + 0.5 * length
    return min(max(low, 0.0), size), min(max(high, 0.0), size)


@njit(cache=True)
def _at(integral, y, x):  # type: ignore[no-untyped-def]
    """The integral between its grid points, so that a box may have any edge."""
    i, j = min(int(y), integral.shape[0] - 2), min(int(x), integral.shape[1] - 2)
    i, j = max(i, 0), max(j, 0)
    if integral.shape[0] < 2 or integral.shape[1] < 2:
        return 0.0
    p, q = y - i, x - j
    return (1.0 - p) * ((1.0 - q) * integral[i, j] + q * integral[i, j + 1]) + p * (
        (1.0 - q) * integral[i + 1, j] + q * integral[i + 1, j + 1]
    )


@njit(cache=True)
def _sums(free, full, x, y, w, h):  # type: ignore[no-untyped-def]
    """Visible and foreground pixels in a box."""
    left, right = _edges(x, w, free.shape[1] - 1.0)
    top, bottom = _edges(y, h, free.shape[0] - 1.0)
    a = _at(free, bottom, right) - _at(free, top, right) - _at(free, bottom, left) + _at(free, top, left)
    b = _at(full, bottom, right) - _at(full, top, right) - _at(full, bottom, left) + _at(full, top, left)
    return a, b
