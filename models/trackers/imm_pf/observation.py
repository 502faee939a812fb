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
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.models.state import H, States, W, X, Y
from lumpwatch.models.trackers.foreground import cleaned
from lumpwatch.models.trackers.imm_pf.kernel import (
    COLOURS,
    MOTIONS,
    Factors,
    Grids,
    colour_bins,
    count_colours,
    observe_boxes,
)

Array = NDArray[np.float64]
STEP = 2
_MOST_COUNTED = 1 << 14


@dataclass(frozen=True, slots=True)
class PictureGrids:
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
    band: float = 0.15
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
class BoxCosts:
    """What boxes look like, each (n,)."""

    cost: Array
    """Minus the log likelihood."""
    appearance: Array
    """The appearance cost A."""
    inside: Array
    """Share of foreground in the box, unknown pixels as neutral."""
    ring: Array
    """Share of foreground around it."""
    visible: Array
    """Share of the box that no nearer target covers."""


def reduced(picture: Image, before: Image | None, mask: Image) -> PictureGrids:
    """Reduce a BGR picture (h, w, 3), its predecessor and its foreground mask (h, w) to grids.

    Raises ValueError where the three do not have the same size.
    """
    if mask.shape != picture.shape[:2] or (before is not None and before.shape != picture.shape):
        raise ValueError("the picture, its predecessor and its mask differ in size")
    small = np.ascontiguousarray(picture[::STEP, ::STEP])
    hsv = cv2.cvtColor(small, cv2.COLOR_BGR2HSV)
    if before is None:
        moved = np.zeros(small.shape[:2], np.uint8)
    else:
        last = cv2.cvtColor(np.ascontiguousarray(before[::STEP, ::STEP]), cv2.COLOR_BGR2GRAY)
        moved = np.asarray(cv2.absdiff(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), last), dtype=np.uint8)
    foreground = (cleaned(mask)[::STEP, ::STEP] > 0).astype(np.uint8)
    rows, columns = mask.shape
    return PictureGrids(colour_bins(hsv), _MOTION_BINS[moved], foreground, (rows, columns))


_MOTION_BINS = np.minimum(np.log2(np.arange(256) / 2.0 + 1.0), MOTIONS - 1).astype(np.uint8)


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


def refer(seen: PictureGrids, state: Array, o: ObservationOptions) -> Reference:
    """The histograms of the box of a state (8,), taken at a birth."""
    covered = np.zeros(seen.colour.shape, np.uint8)
    counts = np.zeros((3, COLOURS))
    place = state[X] / STEP, state[Y] / STEP, state[W] / STEP, state[H] / STEP
    count_colours(_grids(seen, covered, covered), place, _factors(o), counts)
    sums = np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    upper, lower, motion = counts / sums
    return Reference(upper, lower, motion[:MOTIONS].copy())


def difference(a: Reference, b: Reference) -> float:
    """Sum of the squared Bhattacharyya distances of upper and lower half, 0 to 2."""
    return 2.0 - float(np.sqrt(a.upper * b.upper).sum() + np.sqrt(a.lower * b.lower).sum())


def observe(
    seen: PictureGrids,
    states: States,
    reference: Reference,
    usual: float,
    o: ObservationOptions,
    *,
    covered: Image,
    claimed: Image,
) -> BoxCosts:
    """Compare the boxes of states (n, 8) with a reference.

    Grids: `covered` is 1 under nearer targets, `claimed` counts where other targets are expected.
    `usual` is the appearance cost that the target has when it is seen.
    """
    roots = np.zeros((3, COLOURS))
    roots[0], roots[1], roots[2, :MOTIONS] = (
        np.sqrt(reference.upper), np.sqrt(reference.lower), np.sqrt(reference.motion),
    )  # fmt: skip
    boxes = states[:, X] / STEP, states[:, Y] / STEP, states[:, W] / STEP, states[:, H] / STEP
    out = observe_boxes(_grids(seen, covered, claimed), boxes, roots, _ROOTS, usual, _factors(o))
    return BoxCosts(out[0], out[1], out[2], out[3], out[4])


def _grids(seen: PictureGrids, covered: Image, claimed: Image) -> Grids:
    return Grids(seen.colour, seen.motion, seen.foreground, covered, claimed)


def _factors(o: ObservationOptions) -> Factors:
    return Factors(
        colour=o.colour,
        motion=o.motion,
        silhouette=o.silhouette,
        band=o.band,
        core=o.core,
        neutral=o.neutral,
        claim=o.claim,
        foreground_only=o.foreground_only,
    )


_ROOTS = np.sqrt(np.arange(_MOST_COUNTED))
