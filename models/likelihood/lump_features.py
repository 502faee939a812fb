"""What the lump likelihood measures of a box: inside against the ring around it, and along its outline.

All features come from integral images, so a box costs the same whatever its size, and all are ratios
or differences in units of the surroundings' own variation, so that a change of light cancels.

Two scales. The working picture itself shows the grain of a surface. A picture of half its size,
smoothed over three pixels, shows outlines and lumps of light: there noise of the sensor has averaged
out, while rubble has not, so that the same numbers hold by day and by night.

Two sums share one 64-bit word of an integral image. Words wrap around and the lower sum carries into
the upper one, but all of it cancels in the difference of a box's corners.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

from models.likelihood.base import box_edges, box_inside
from models.roi import Image

FEATURES = (
    "brightness",
    "contrast",
    "weakest_side",
    "texture",
    "outline",
    "spread",
    "core_texture",
    "ring_texture",
    "broad_contrast",
    "edge",
    "weakest_edge",
    "edge_inside",
    "edge_outside",
    "corners",
    "broad_texture",
    "broad_spread",
    "broad_outline",
    "weakest_outline",
    "shadow",
    "grain",
)
"""What `measure` writes, in order."""

N_FEATURES = len(FEATURES)
_NOISE = 2.0  # grey levels; keeps ratios of flat patches finite
_BROAD_NOISE = 1.0  # the same for the smoothed picture
_INNER, _RING, _BAND = 0.7, 1.5, 1.2
_SIDE = 0.6  # share of a side along which its edge is measured: the corners of a box show no lump
_STEPS = np.array([0.55, 0.78, 1.0, 1.25, 1.55])
"""Strips along each side lie between these shares of the half size."""
_UPPER, _LOWER = np.uint64(32), np.uint64(0xFFFFFFFF)
_SQUARES, _DOWN = np.uint64(28), np.uint64(0xFFFFFFF)  # enough for every smoothed picture, 960 x 960 at most


def smoothed(gray: Image) -> Image:
    """The picture of half the size, the odd last row and column left out, smoothed over three pixels."""
    h, w = gray.shape[0] // 2, gray.shape[1] // 2
    half = cv2.resize(gray[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.blur(half, (3, 3)), dtype=np.uint8)


@njit(cache=True)
def integrate(gray, out):  # type: ignore[no-untyped-def]
    """Integral images of brightness, its square and the gradient (|dx| + |dy| of the neighbours).

    One pass over the picture, the sums of a pixel side by side in memory.
    """
    height, width = gray.shape
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        row, row_of_squares = np.uint64(0), np.uint64(0)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            value = np.uint64(gray[y, x])
            dx = np.int32(gray[y, right]) - np.int32(gray[y, left])
            dy = np.int32(gray[below, x]) - np.int32(gray[above, x])
            row += (value << _UPPER) + np.uint64(abs(dx) + abs(dy))
            row_of_squares += value * value
            out[y + 1, x + 1, 0] = out[y, x + 1, 0] + row
            out[y + 1, x + 1, 1] = out[y, x + 1, 1] + row_of_squares


@njit(cache=True)
def integrate_broad(half, out):  # type: ignore[no-untyped-def]
    """Integral images of the smoothed picture: brightness with |dx|, and its square with |dy|."""
    height, width = half.shape
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        row, row_of_squares = np.uint64(0), np.uint64(0)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            value = np.uint64(half[y, x])
            dx = abs(np.int32(half[y, right]) - np.int32(half[y, left]))
            dy = abs(np.int32(half[below, x]) - np.int32(half[above, x]))
            row += (value << _UPPER) + np.uint64(dx)
            row_of_squares += ((value * value) << _SQUARES) + np.uint64(dy)
            out[y + 1, x + 1, 0] = out[y, x + 1, 0] + row
            out[y + 1, x + 1, 1] = out[y, x + 1, 1] + row_of_squares


@njit(cache=True)
def _difference(sums, x0, y0, x1, y1, k):  # type: ignore[no-untyped-def]
    return sums[y1, x1, k] - sums[y0, x1, k] - sums[y1, x0, k] + sums[y0, x0, k]


@njit(cache=True)
def _sums_of(sums, box):  # type: ignore[no-untyped-def]
    """Brightness, square, gradient and area of a box."""
    x0, y0, x1, y1 = box
    both, area = _difference(sums, x0, y0, x1, y1, 0), (x1 - x0) * (y1 - y0)
    return (
        float(both >> _UPPER),
        float(_difference(sums, x0, y0, x1, y1, 1)),
        float(both & _LOWER),
        float(area),
    )


@njit(cache=True)
def _brightness(sums, box):  # type: ignore[no-untyped-def]
    """Mean brightness of a box that is not empty."""
    x0, y0, x1, y1 = box
    return float(_difference(sums, x0, y0, x1, y1, 0) >> _UPPER) / ((x1 - x0) * (y1 - y0))


@njit(cache=True)
def measure(sums, broad, inside, state, least_inside, out):  # type: ignore[no-untyped-def]
    """Write the features of one state's box; False, and nothing written, where it is no object."""
    if state[6] < 3.0 or state[7] < 3.0:
        return False
    box, share = box_inside(inside, state)
    if share < least_inside:
        return False
    sign = _measure_fine(sums, box, state, out)
    _measure_broad(broad, box, state, sign, out)
    return True


@njit(cache=True)
def _measure_fine(sums, box, state, out):  # type: ignore[no-untyped-def]
    """The features of the working picture; returns 1 for an inside brighter than the ring, else -1."""
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    ring = box_edges(state, _RING, width, height)
    b_in, s_in, g_in, n_in = _sums_of(sums, box_edges(state, _INNER, width, height))
    b_box, s_box, g_box, n_box = _sums_of(sums, box)
    b_ring, s_ring, g_ring, n_ring = _sums_of(sums, ring)
    _, _, g_band, n_band = _sums_of(sums, box_edges(state, _BAND, width, height))
    n_in, n_outer = max(n_in, 1.0), max(n_ring - n_box, 1.0)
    mean_in, mean_ring = b_in / n_in, (b_ring - b_box) / n_outer
    spread_in = np.sqrt(max(s_in / n_in - mean_in**2, 0.0))
    noise = np.sqrt(max((s_ring - s_box) / n_outer - mean_ring**2, 0.0)) + _NOISE
    left = (ring[0], box[1], box[0], box[3])
    right = (box[2], box[1], ring[2], box[3])
    above = (box[0], ring[1], box[2], box[1])
    below = (box[0], box[3], box[2], ring[3])
    weakest = 1e9
    sign = 1.0 if mean_in >= mean_ring else -1.0
    for side in (left, right, above, below):
        if (side[2] - side[0]) * (side[3] - side[1]) > 0:
            weakest = min(weakest, sign * (mean_in - _brightness(sums, side)) / noise)
    log_in = np.log(g_in / n_in + _NOISE)
    log_ring = np.log((g_ring - g_box) / n_outer + _NOISE)
    log_band = np.log((g_band - g_in) / max(n_band - n_in, 1.0) + _NOISE)
    log_noise = np.log(noise)
    out[0] = (mean_in - mean_ring) / noise
    out[1] = abs(mean_in - mean_ring) / noise
    out[2] = weakest if weakest < 1e9 else 0.0
    out[3] = log_in - log_ring
    out[4] = log_band - log_in
    out[5] = np.log(spread_in + _NOISE) - log_noise
    out[6] = log_in - log_noise
    out[7] = log_ring - log_noise
    out[19] = log_noise  # less the broad one, see `_measure_broad`
    return sign


@njit(cache=True)
def _whole(value, most):  # type: ignore[no-untyped-def]
    return min(max(int(np.floor(value + 0.5)), 0), most)


@njit(cache=True)
def _broad_sums(sums, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Brightness, square, gradient and area of a box of the smoothed picture."""
    first, second = _difference(sums, x0, y0, x1, y1, 0), _difference(sums, x0, y0, x1, y1, 1)
    return (
        float(first >> _UPPER),
        float(second >> _SQUARES),
        float(first & _LOWER) + float(second & _DOWN),
        float((x1 - x0) * (y1 - y0)),
    )


@njit(cache=True)
def _measure_broad(sums, box, state, sign, out):  # type: ignore[no-untyped-def]
    """The features of the smoothed picture."""
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    x, y, half_w, half_h = 0.5 * state[0], 0.5 * state[1], 0.25 * state[6], 0.25 * state[7]

    b_in, s_in, g_in, n_in = _broad_sums(
        sums,
        _whole(x - _INNER * half_w, width),
        _whole(y - _INNER * half_h, height),
        _whole(x + _INNER * half_w, width),
        _whole(y + _INNER * half_h, height),
    )
    x0, y0 = _whole(x - half_w, width), _whole(y - half_h, height)
    x1, y1 = _whole(x + half_w, width), _whole(y + half_h, height)
    b_box, s_box, g_box, n_box = _broad_sums(sums, x0, y0, x1, y1)
    b_ring, s_ring, g_ring, n_ring = _broad_sums(
        sums,
        _whole(x - _RING * half_w, width),
        _whole(y - _RING * half_h, height),
        _whole(x + _RING * half_w, width),
        _whole(y + _RING * half_h, height),
    )
    n_in, n_outer = max(n_in, 1.0), max(n_ring - n_box, 1.0)
    mean_in, mean_ring = b_in / n_in, (b_ring - b_box) / n_outer
    spread_in = np.sqrt(max(s_in / n_in - mean_in**2, 0.0))
    noise = np.sqrt(max((s_ring - s_box) / n_outer - mean_ring**2, 0.0)) + _BROAD_NOISE
    texture_in = g_in / n_in + _BROAD_NOISE
    texture_ring = max(g_ring - g_box, 0.0) / n_outer + _BROAD_NOISE

    edge, weakest, inner, outer, sides, inner_sides, outer_sides = 0.0, 1e9, 0.0, 0.0, 0, 0, 0
    outline, faintest, outlined = 0.0, 1e9, 0
    above = below = mean_ring
    mean = np.empty(4)
    for side in range(4):
        for k in range(4):
            near, far = _STEPS[k], _STEPS[k + 1]
            if side < 2:  # left, right
                direction = -1.0 if side == 0 else 1.0
                a = _whole(x + direction * near * half_w, width)
                b = _whole(x + direction * far * half_w, width)
                left, right = min(a, b), max(a, b)
                top, bottom = _whole(y - _SIDE * half_h, height), _whole(y + _SIDE * half_h, height)
            else:
                direction = -1.0 if side == 2 else 1.0
                a = _whole(y + direction * near * half_h, height)
                b = _whole(y + direction * far * half_h, height)
                top, bottom = min(a, b), max(a, b)
                left, right = _whole(x - _SIDE * half_w, width), _whole(x + _SIDE * half_w, width)
            area = (right - left) * (bottom - top)
            if area > 0:
                mean[k] = float(_difference(sums, left, top, right, bottom, 0) >> _UPPER) / area
            else:
                mean[k] = np.nan
        if not np.isnan(mean[1] + mean[2]):
            step = sign * (mean[1] - mean[2]) / noise
            edge += step
            weakest = min(weakest, step)
            sides += 1
            if side == 2:
                above = mean[2]
            elif side == 3:
                below = mean[2]
        if not np.isnan(mean[0] + mean[1]):
            inner += sign * (mean[0] - mean[1]) / noise
            inner_sides += 1
        if not np.isnan(mean[2] + mean[3]):
            outer += sign * (mean[2] - mean[3]) / noise
            outer_sides += 1
        # The gradient across the side, in a band of a tenth of the size on both sides of it.
        if side < 2:
            place = x - half_w if side == 0 else x + half_w
            left, right = _whole(place - 0.2 * half_w, width), _whole(place + 0.2 * half_w, width)
            top, bottom = _whole(y - _SIDE * half_h, height), _whole(y + _SIDE * half_h, height)
        else:
            place = y - half_h if side == 2 else y + half_h
            top, bottom = _whole(place - 0.2 * half_h, height), _whole(place + 0.2 * half_h, height)
            left, right = _whole(x - _SIDE * half_w, width), _whole(x + _SIDE * half_w, width)
        area = (right - left) * (bottom - top)
        if area > 0:
            if side < 2:
                across = float(_difference(sums, left, top, right, bottom, 0) & _LOWER)
            else:
                across = float(_difference(sums, left, top, right, bottom, 1) & _DOWN)
            strength = np.log(2.0 * across / area + _BROAD_NOISE)
            outline += strength
            faintest = min(faintest, strength)
            outlined += 1

    corner, corners = 0.0, 0
    for side in range(4):
        right, bottom = side % 2 == 1, side >= 2
        cx0 = _whole(x + (0.75 if right else -1.05) * half_w, width)
        cx1 = _whole(x + (1.05 if right else -0.75) * half_w, width)
        cy0 = _whole(y + (0.75 if bottom else -1.05) * half_h, height)
        cy1 = _whole(y + (1.05 if bottom else -0.75) * half_h, height)
        area = (cx1 - cx0) * (cy1 - cy0)
        if area > 0:
            corner += float(_difference(sums, cx0, cy0, cx1, cy1, 0) >> _UPPER) / area
            corners += 1

    log_in, log_ring, log_noise = np.log(texture_in), np.log(texture_ring), np.log(noise)
    out[8] = abs(mean_in - mean_ring) / noise
    out[9] = edge / max(sides, 1)
    out[10] = weakest if sides > 0 else 0.0
    out[11] = inner / max(inner_sides, 1)
    out[12] = outer / max(outer_sides, 1)
    out[13] = sign * (mean_in - corner / corners) / noise if corners > 0 else 0.0
    out[14] = log_in - log_ring
    out[15] = np.log(spread_in + _BROAD_NOISE) - log_noise
    out[16] = outline / outlined - log_in if outlined > 0 else 0.0
    out[17] = faintest - log_ring if outlined > 0 else 0.0
    out[18] = (above - below) / noise
    out[19] -= log_noise
