"""Ore without end: windows of real frames, joined along seams that go around rocks (after Efros, Freeman 2001).

Nothing is faded into each other: each pixel belongs to one window, and the seam between two windows is the
cheapest path through their overlap, where a step inside a rock costs more the larger the rock is. A rock counts
as a body where all of it shows; one that a seam or the strip's edge cuts is told as cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.reproduction.real.ore import Image, Piece, Points, Rock, long_side, rounded

_SHOWS, _GONE = 0.94, 0.08
"""Shares of a rock from which on it counts as whole, and below which as not there."""
_TOLD = 0.5
"""Smaller rocks, in sizes of `large`, are no bodies."""
_SEAM_IN_ROCK = 6000.0
_DRAWS, _TRIES = 60, 5
"""Windows drawn for a place, and how many of the most fitting are tried there."""
_FOR_UNCLEAR, _FOR_COUNT = 0.5, 0.8
_ENOUGH_ORE, _LEAST = 0.985, 40


@dataclass(frozen=True, slots=True)
class Body:
    """A rock on a strip."""

    corners: Points
    """(n, 2), pixels of the strip."""
    size: float
    """The longer side of its upright box, pixels of the strip."""
    cut: bool = False
    """Not all of it shows: nobody can say how large it looks."""


@dataclass(frozen=True, slots=True)
class Strip:
    """A belt's load from above; its last row leaves first."""

    pixels: Image
    """BGR (h, w, 3)."""
    bodies: tuple[Body, ...]


@dataclass(frozen=True, slots=True)
class Quilt:
    """How a strip is put together."""

    width: int
    length: int
    window: int
    """Side of the windows, pixels of the strip."""
    scale: tuple[float, float]
    """Pixels of the strip for one of the pictures, least and most."""
    large: float
    """Rocks of this size and above must not be cut, pixels of the strip."""
    unclear: float = np.inf
    """From this size up to `large` nobody can say at a glance: windows with fewer of them are preferred."""
    lumps: float | None = None
    """How many rocks of `large` and above the strip should show; None: as they come."""
    largest: float = np.inf
    """Windows with rocks above this size are not taken."""
    evenness: float = 0.6
    """How much of the difference in brightness from window to window is taken away."""

    @property
    def overlap(self) -> int:
        """Pixels that two windows share."""
        return round(self.window * 0.3)


class _Window:
    """A part of a frame, turned and mirrored; its pixels are made when they are asked for."""

    def __init__(
        self, source: Piece, at: tuple[int, int], side: int, size: int, turn: int, mirror: bool
    ) -> None:
        self._source, self._at, self._side, self._size = source, at, side, size
        self._turn, self._mirror = turn, mirror
        low, high = np.array(at), np.array(at) + side
        inside = np.all(source.boxes[:, 2:] >= low, axis=1) & np.all(source.boxes[:, :2] <= high, axis=1)
        self._mine = [source.rocks[k] for k in np.flatnonzero(inside)]
        self.lengths = np.array([rock.length for rock in self._mine]) * (size / side)
        """Of its rocks, pixels of the strip."""
        self.whole = np.array([rock.whole for rock in self._mine], bool)

    def rocks(self, least: float = 0.0) -> list[Rock]:
        """Those of this size and above, in pixels of the window."""
        return [
            Rock(self._turned(rock.corners), rock.whole, float(length), rock.agglomerate)
            for rock, length in zip(self._mine, self.lengths, strict=True)
            if length >= least
        ]

    def _turned(self, corners: Points) -> Points:
        size = self._size
        corners = (corners - self._at) * (size / self._side)
        for _ in range(self._turn):
            corners = np.column_stack([corners[:, 1], size - 1 - corners[:, 0]])
        return np.column_stack([size - 1 - corners[:, 0], corners[:, 1]]) if self._mirror else corners

    def pixels(self, tone: float, evenness: float) -> Image:
        """BGR (size, size, 3)."""
        (x, y), side, size = self._at, self._side, self._size
        how = cv2.INTER_AREA if size < side else cv2.INTER_CUBIC
        part = cv2.resize(self._source.pixels[y : y + side, x : x + side], (size, size), interpolation=how)
        turned = np.rot90(part, self._turn)
        gain = (tone / max(float(turned.mean()), 1.0)) ** evenness
        shown = np.ascontiguousarray(turned[:, ::-1] if self._mirror else turned)
        return np.asarray(cv2.convertScaleAbs(shown, alpha=gain), np.uint8)

    def weight(self) -> NDArray[np.float32]:
        """The size of the rock at each pixel."""
        weight = np.zeros((self._size, self._size), np.float32)
        for rock in sorted(self.rocks(), key=lambda one: one.length):
            cv2.fillPoly(weight, [rounded(rock.corners)], (rock.length,))
        return weight


@dataclass(frozen=True, slots=True)
class _Choice:
    damage: float
    window: _Window
    mask: NDArray[np.bool_]
    pixels: Image
    weight: NDArray[np.float32]
    lumps: int


def quilt(rng: np.random.Generator, sources: Sequence[Piece], plan: Quilt) -> Strip:
    """Make a strip, with smaller windows than planned where the pictures hold none that large."""
    while True:
        try:
            return _quilt(rng, sources, plan)
        except _NoWindowError:
            plan = replace(plan, window=round(plan.window * 0.85))


class _NoWindowError(ValueError):
    """The pictures hold no window full of ore that large."""


def _quilt(rng: np.random.Generator, sources: Sequence[Piece], plan: Quilt) -> Strip:
    step = plan.window - plan.overlap
    columns = max(1, -(-(plan.width - plan.overlap) // step))
    rows = max(1, -(-(plan.length - plan.overlap) // step))
    shape = rows * step + plan.overlap, columns * step + plan.overlap
    canvas, owner = np.zeros((*shape, 3), np.uint8), np.full(shape, -1, np.int32)
    weight = np.zeros(shape, np.float32)
    placed: list[tuple[int, int, _Window]] = []
    tone = _tone(sources)
    have = 0
    for row in range(rows):
        for column in range(columns):
            y, x = row * step, column * step
            here = slice(y, y + plan.window), slice(x, x + plan.window)
            wanted = None if plan.lumps is None else plan.lumps * (len(placed) + 1) / (rows * columns) - have
            best: _Choice | None = None
            drawn = [_draw(rng, sources, plan) for _ in range(_DRAWS if plan.lumps is not None else 1)]
            for window in sorted(drawn, key=lambda one: _unfit(one, plan, wanted))[:_TRIES]:
                pixels, heavy = window.pixels(tone, plan.evenness), window.weight()
                heavier = np.maximum(heavy, weight[here])
                mask = _mask(canvas[here], owner[here], heavier, pixels, plan, column > 0, row > 0)
                damage = _damage(owner[here], mask, window, (y, x), placed, plan)
                lumps = sum(
                    rock.whole and _share(mask, rock.corners) > _SHOWS for rock in window.rocks(plan.large)
                )
                if wanted is not None:
                    damage += _FOR_COUNT * max(abs(lumps - wanted) - 0.5, 0.0)
                if best is None or damage < best.damage:
                    best = _Choice(damage, window, mask, pixels, heavy, lumps)
                if damage == 0:
                    break
            assert best is not None
            have += best.lumps
            canvas[here][best.mask] = best.pixels[best.mask]
            weight[here][best.mask] = best.weight[best.mask]
            owner[here][best.mask] = len(placed)
            placed.append((y, x, best.window))
    soft = _soften(canvas, owner)
    left = (shape[1] - plan.width) // 2
    top = shape[0] - plan.length
    bodies = _bodies(placed, owner, left, top, plan)
    return Strip(np.ascontiguousarray(soft[top:, left : left + plan.width]), bodies)


def _tone(sources: Sequence[Piece]) -> float:
    return float(np.mean([one.pixels[one.ore].mean() for one in sources if one.ore.any()]))


def _draw(rng: np.random.Generator, sources: Sequence[Piece], plan: Quilt) -> _Window:
    """A window full of ore, turned and mirrored at random."""
    area = np.array([one.ore.sum() for one in sources], float)
    found = None
    for _ in range(400 if plan.largest < np.inf else 120):
        source = sources[int(rng.choice(len(sources), p=area / area.sum()))]
        scale = float(rng.uniform(*plan.scale))
        side = round(plan.window / scale)
        height, width = source.ore.shape
        if side > min(height, width):
            continue
        x, y = int(rng.integers(0, width - side + 1)), int(rng.integers(0, height - side + 1))
        if source.ore[y : y + side, x : x + side].mean() < _ENOUGH_ORE:
            continue
        found = _Window(source, (x, y), side, plan.window, int(rng.integers(4)), bool(rng.integers(2)))
        if found.lengths.max(initial=0.0) <= plan.largest:
            break
    if found is None:
        if plan.window < _LEAST:
            raise ValueError("the pictures hold no ore")
        raise _NoWindowError
    return found


def _unfit(window: _Window, plan: Quilt, wanted: float | None) -> float:
    """How little a window fits before anyone tries where its seams run."""
    large = window.whole & (window.lengths >= plan.large)
    lumps, unclear = int(large.sum()), int(((window.lengths > plan.unclear) & ~large).sum())
    miss = 0.0 if wanted is None else max(abs(lumps - wanted) - 0.5, 0.0)
    return _FOR_UNCLEAR * unclear + _FOR_COUNT * miss


def _mask(
    canvas: Image,
    owner: NDArray[np.int32],
    weight: NDArray[np.float32],
    pixels: Image,
    plan: Quilt,
    left: bool,
    above: bool,
) -> NDArray[np.bool_]:
    """Which pixels of its place the window gets."""
    size, overlap = plan.window, plan.overlap
    mask = np.ones((size, size), bool)
    difference = np.square(canvas.astype(np.float32) - pixels).sum(axis=2)
    heavy = weight / max(plan.large, 1.0)
    cost = difference / 30.0 + 20.0 + _SEAM_IN_ROCK * np.minimum(heavy, 1.5) ** 2
    if left:
        path = _path(cost[:, :overlap])
        mask[:, :overlap] &= np.arange(overlap)[None, :] >= path[:, None]
    if above:
        path = _path(cost[:overlap].T)
        mask[:overlap] &= np.arange(overlap)[:, None] >= path[None, :]
    return mask | (owner < 0)


def _path(cost: NDArray[np.float32]) -> NDArray[np.intp]:
    """The cheapest way down: a column for each row."""
    height, width = cost.shape
    total = np.empty((height, width), np.float64)
    total[0] = cost[0]
    padded = np.full(width + 2, np.inf)
    for y in range(1, height):
        padded[1:-1] = total[y - 1]
        total[y] = cost[y] + np.minimum(np.minimum(padded[:-2], padded[2:]), padded[1:-1])
    path = np.empty(height, np.intp)
    path[-1] = total[-1].argmin()
    for y in range(height - 2, -1, -1):
        low = max(path[y + 1] - 1, 0)
        path[y] = low + total[y, low : path[y + 1] + 2].argmin()
    return path


def _visible(mask: NDArray[np.bool_], corners: Points, y: int, x: int) -> Points:
    """The outline of what a mask at (y, x) leaves of an outline."""
    inside = np.zeros(mask.shape, np.uint8)
    cv2.fillPoly(inside, [rounded(corners - (x, y))], (1,))
    inside &= mask
    outlines, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not outlines:
        return np.zeros((1, 2))
    return np.add(np.asarray(max(outlines, key=cv2.contourArea), float).reshape(-1, 2), (x, y))


def _share(mask: NDArray[np.bool_], corners: Points, y: int = 0, x: int = 0) -> float:
    """The share of an outline that a mask holds; (y, x) is where the mask lies."""
    low = np.floor(corners.min(axis=0)).astype(int)
    high = np.ceil(corners.max(axis=0)).astype(int) + 1
    inside = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    cv2.fillPoly(inside, [rounded(corners - low)], (1,))
    low, high = low - (x, y), high - (x, y)
    a, b = max(low[1], 0), min(high[1], mask.shape[0])
    c, d = max(low[0], 0), min(high[0], mask.shape[1])
    if a >= b or c >= d:
        return 0.0
    part = inside[a - low[1] : b - low[1], c - low[0] : d - low[0]]
    return float((part.astype(bool) & mask[a:b, c:d]).sum() / max(int(inside.sum()), 1))


def _damage(
    owner: NDArray[np.int32],
    mask: NDArray[np.bool_],
    window: _Window,
    at: tuple[int, int],
    placed: Sequence[tuple[int, int, _Window]],
    plan: Quilt,
) -> float:
    """How many large rocks the window would cut, or brings cut ones, counted by size."""
    total = 0.0
    for rock in window.rocks(min(plan.large, plan.unclear)):
        if rock.length >= plan.large:
            share = _share(mask, rock.corners)
            if share > _GONE and (share < _SHOWS or not rock.whole):
                total += rock.length / plan.large
        elif rock.length > plan.unclear and _share(mask, rock.corners) > 0.5:
            total += _FOR_UNCLEAR
    for k in np.unique(owner[mask & (owner >= 0)]):
        y, x, other = placed[k]
        large = other.rocks(plan.large)
        if not large:
            continue
        old = owner == k
        for rock in large:
            corners = np.add(rock.corners, (x, y))
            lost = _share(old & mask, corners, *at)
            if lost > 1 - _SHOWS and lost < _share(old, corners, *at) - _GONE:
                total += rock.length / plan.large
    return total


def _soften(canvas: Image, owner: NDArray[np.int32]) -> Image:
    """Smooth the seams by about a pixel, as the camera's lens would."""
    seam = np.zeros(owner.shape, np.uint8)
    seam[:, 1:] |= owner[:, 1:] != owner[:, :-1]
    seam[1:] |= owner[1:] != owner[:-1]
    alpha = cv2.GaussianBlur(cv2.dilate(seam, np.ones((3, 3), np.uint8)).astype(np.float32), (0, 0), 1.0)[
        ..., None
    ]
    blurred = cv2.GaussianBlur(canvas, (0, 0), 1.2)
    return np.asarray(np.round(canvas * (1 - alpha) + blurred * alpha), np.uint8)


def _bodies(
    placed: Sequence[tuple[int, int, _Window]], owner: NDArray[np.int32], left: int, top: int, plan: Quilt
) -> tuple[Body, ...]:
    bodies = []
    seen = owner[top:, left : left + plan.width]
    for k, (y, x, window) in enumerate(placed):
        low_y, low_x = max(y - top, 0), max(x - left, 0)
        mine = seen[low_y : max(y - top + plan.window, 0), low_x : max(x - left + plan.window, 0)] == k
        for rock in window.rocks(_TOLD * plan.large):
            corners = np.add(rock.corners, (x - left, y - top))
            share = _share(mine, corners, low_y, low_x)
            if share <= _GONE:
                continue
            # A little may be hidden by what lies beside it, as it is with any rock.
            cut = share < _SHOWS or not rock.whole or rock.agglomerate
            if cut:
                corners = _visible(mine, corners, low_y, low_x)
            corners = np.clip(corners, 0, (plan.width - 1, plan.length - 1))
            if long_side(corners) >= _TOLD * plan.large:
                bodies.append(Body(corners, long_side(corners), cut))
    return tuple(bodies)
