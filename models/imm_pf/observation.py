"""What the filter sees: colour, motion and foreground of a box (paper 2, section 4.3).

The picture is reduced once to a grid of every `STEP`-th pixel with a colour bin and a motion bin:

* colour: hue and saturation (10 x 8 bins) where the pixel has colour, brightness (10 bins) where not,
  after Perez, Vermaak, Blake (2004), one histogram of the upper and one of the lower half of the box;
* motion: absolute difference to the last picture's brightness (8 bins of growing width).

Each is compared with the reference taken at birth by the squared Bhattacharyya distance
d^2 = 1 - sum sqrt(p q). The log likelihood of a particle is minus its cost

    cost = v A + (1 - v) usual + silhouette (1 - inside + ring)
    A    = colour (d_up^2 + d_low^2) + motion d_mot^2

What goes beyond the paper can be switched off:

* `silhouette` (0 for off): colour alone hardly tells where a person ends. `inside` is the share of
  foreground in the box and `ring` that in a band around it.
* `foreground_only`: histograms count the pixels of the foreground, so that the pavement behind a
  walking person does not make him another one.
* Pixels that a nearer target covers are unknown. v is the share of the box that is not covered; for
  the rest the target is charged what it usually costs, and its pixels count as `neutral` foreground:
  better than bare ground, worse than a body. Hiding gains nothing while one is seen, and a hidden
  target follows its motion model.
* `claim`: foreground where another target is expected is explained already, so it counts as neutral
  to this degree; a target is not drawn to its neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.foreground import cleaned
from models.roi import Image
from models.state import H, States, W, X, Y

Array = NDArray[np.float64]
STEP = 2
HUES, SATURATIONS, VALUES = 10, 8, 10
COLOURS = HUES * SATURATIONS + VALUES
MOTIONS = 8
_COLOURED = 26
"""Saturation and brightness from which a pixel has a colour."""
_SEEN_LEAST = 0.15
"""A box visible by less than this share says nothing."""
_MOST_COUNTED = 1 << 14


@dataclass(frozen=True, slots=True)
class Look:
    """One picture, ready for the observation of all targets; grids (h / STEP, w / STEP)."""

    colour: Image
    motion: Image
    foreground: Image
    """1 where the cleaned foreground mask is set."""
    shape: tuple[int, int]
    """Height and width of the picture."""


@dataclass(frozen=True, slots=True)
class ObservationOptions:
    """Factors of the log likelihood."""

    colour: float = 4.0
    motion: float = 0.5
    silhouette: float = 12.0
    """0 leaves the foreground's shape out, as the paper has it."""
    foreground_only: bool = True
    """Whether histograms leave the background out."""
    neutral: float = 0.3
    """Foreground that an unknown pixel counts for."""
    claim: float = 1.0
    """How far foreground is explained by another target that is expected there."""
    band: float = 0.25
    """Width of the ring on each side, in widths of the box."""
    core: float = 0.8
    """Part of the width and height of the box whose colours count."""

    def __post_init__(self) -> None:
        """Raises ValueError for numbers that cannot be meant."""
        if min(self.colour, self.motion, self.silhouette) < 0.0 or min(self.band, self.core) <= 0.0:
            raise ValueError("factors of the log likelihood must not be negative, band and core be positive")
        if not (0.0 <= self.neutral <= 1.0 and 0.0 <= self.claim <= 1.0):
            raise ValueError("neutral and claim must lie within 0 and 1")


@dataclass(frozen=True, slots=True)
class Reference:
    """How a target looked at birth; histograms that sum to 1."""

    upper: Array
    lower: Array
    motion: Array


@dataclass(frozen=True, slots=True)
class Seen:
    """What boxes look like, each (n,)."""

    cost: Array
    """Minus the log likelihood."""
    looks: Array
    """The appearance cost A."""
    inside: Array
    """Share of foreground in the box, unknown pixels as neutral."""
    ring: Array
    """Share of foreground around it."""
    visible: Array
    """Share of the box that no nearer target covers."""


def look(picture: Image, before: Image | None, mask: Image) -> Look:
    """Reduce a BGR picture (h, w, 3), its predecessor and its foreground mask (h, w) to grids.

    Raises ValueError where the three do not have the same size.
    """
    if mask.shape != picture.shape[:2] or (before is not None and before.shape != picture.shape):
        raise ValueError("the picture, its predecessor and its mask differ in size")
    small = np.ascontiguousarray(picture[::STEP, ::STEP])
    hsv = cv2.cvtColor(small, cv2.COLOR_BGR2HSV)
    if before is None:
        difference = np.zeros(small.shape[:2], np.uint8)
    else:
        last = np.ascontiguousarray(before[::STEP, ::STEP])
        gray = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        difference = cv2.absdiff(gray, cv2.cvtColor(last, cv2.COLOR_BGR2GRAY))
    foreground = (cleaned(mask)[::STEP, ::STEP] > 0).astype(np.uint8)
    return Look(_colour_bins(hsv), cv2.LUT(difference, _MOTION_BINS), foreground, mask.shape)


_MOTION_BINS = np.minimum(np.log2(np.arange(256) / 2.0 + 1.0), MOTIONS - 1).astype(np.uint8)


@njit(cache=True)
def _colour_bins(hsv):  # type: ignore[no-untyped-def]
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


def paint(grid: Image, state: Array, part: float, value: int) -> None:
    """Set the inner `part` of the box of a state (8,) to a value, on a grid."""
    grid[_inner(state, part)] = value


def add(grid: Image, state: Array, part: float, value: int) -> None:
    """Add 1 or -1 there instead."""
    grid[_inner(state, part)] += np.uint8(value % 256)


def _inner(state: Array, part: float) -> tuple[slice, slice]:
    def edges(centre: float, length: float) -> slice:
        reach = part * length / 2
        return slice(max(int((centre - reach) / STEP + 0.5), 0), max(int((centre + reach) / STEP + 0.5), 0))

    return edges(float(state[Y]), float(state[H])), edges(float(state[X]), float(state[W]))


def refer(seen: Look, state: Array, o: ObservationOptions) -> Reference:
    """The histograms of the box of a state (8,), taken at a birth."""
    covered = np.zeros(seen.colour.shape, np.uint8)
    histograms = np.zeros((3, COLOURS))
    _histograms(
        seen.colour, seen.motion, seen.foreground, o.foreground_only, covered, state[X] / STEP, state[Y] / STEP, state[W] / STEP, state[H] / STEP,
        o.core, histograms,
    )  # fmt: skip
    sums = np.maximum(histograms.sum(axis=1, keepdims=True), 1.0)
    upper, lower, motion = histograms / sums
    return Reference(upper, lower, motion[:MOTIONS].copy())


def difference(a: Reference, b: Reference) -> float:
    """Sum of the squared Bhattacharyya distances of upper and lower half, 0 to 2."""
    return 2.0 - float(np.sqrt(a.upper * b.upper).sum() + np.sqrt(a.lower * b.lower).sum())


def observe(
    seen: Look, states: States, reference: Reference, usual: float, o: ObservationOptions, covered: Image, claimed: Image
) -> Seen:
    """Compare the boxes of states (n, 8) with a reference.

    Grids: `covered` is 1 under nearer targets, `claimed` counts where other targets are expected.
    `usual` is the appearance cost that the target has when it is seen.
    """
    roots = np.zeros((3, COLOURS))
    roots[0], roots[1], roots[2, :MOTIONS] = (
        np.sqrt(reference.upper), np.sqrt(reference.lower), np.sqrt(reference.motion),
    )  # fmt: skip
    out = _observe(
        seen.colour, seen.motion, seen.foreground, covered, claimed,
        states[:, X] / STEP, states[:, Y] / STEP, states[:, W] / STEP, states[:, H] / STEP, roots, _ROOTS, usual,
        o.colour, o.motion, o.silhouette, o.band, o.core, o.neutral, o.claim,
        o.foreground_only,
    )  # fmt: skip
    return Seen(out[0], out[1], out[2], out[3], out[4])


_ROOTS = np.sqrt(np.arange(_MOST_COUNTED))


@njit(cache=True)
def _histograms(colour, motion, foreground, only, covered, x, y, w, h, core, out):  # type: ignore[no-untyped-def]
    """Count the visible pixels of the core of a box into rows upper, lower, motion; give their numbers."""
    rows, columns = colour.shape
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
def _observe(  # type: ignore[no-untyped-def]
    colour, motion, foreground, covered, claimed, x, y, w, h, roots, table, usual,
    c_colour, c_motion, c_silhouette, band, core, neutral, claim, only
):  # fmt: skip
    n = len(x)
    rows, columns = colour.shape
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
        looks = usual
        if visible >= _SEEN_LEAST:
            counts[:] = 0
            upper, lower = _histograms(
                colour, motion, foreground, only, covered, x[k], y[k], width, height, core, counts
            )
            distance = _distance(counts[0], roots[0], table, upper) + _distance(
                counts[1], roots[1], table, lower
            )
            moved = _distance(counts[2, :MOTIONS], roots[2], table, upper + lower)
            out[1, k] = c_colour * distance + c_motion * moved
            looks = visible * out[1, k] + (1.0 - visible) * usual
        out[0, k] = looks + c_silhouette * (1.0 - inside + ring)
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
