"""Loads of a belt that are laid stone by stone: lumps on fine ore, and stones of all sizes side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.reproduction.real.ore import Image, Piece, Points, long_side, rounded
from tests.reproduction.real.stones import Cutout, Stone, cutout, lay, stones
from tests.reproduction.real.strip import Body, Quilt, Strip, quilt

_SHOWS = 0.8


@dataclass(frozen=True, slots=True)
class Load:
    """What lies on a belt."""

    width: int
    length: int
    limit: float
    """Pixels of the strip."""
    lumps: int
    sizes: tuple[float, float] = (0.95, 1.9)
    """Of lumps, in limits."""
    medium: int = 150
    medium_sizes: tuple[float, float] = (0.2, 0.55)
    fine: float = 0.5
    """The largest rock of the ore beneath, in limits."""
    shade: float = 0.45
    slope: float = 2.3
    """Of stones side by side: how much rarer large ones are, the exponent of their number by size."""
    least: float = 0.1
    """Smallest stone that is laid, in limits."""


def composite(rng: np.random.Generator, sources: Sequence[Piece], load: Load) -> Strip:
    """Real ore as fines, with real rocks on it: medium ones and lumps."""
    # A rock of the pictures has 130 pixels at most.
    scale = load.fine * load.limit / 125.0
    plan = Quilt(
        load.width, load.length, max(40, round(230 * scale)), (0.75 * scale, scale), load.limit, evenness=0.75
    )
    pixels = quilt(rng, sources, plan).pixels.copy()
    rocks = stones(sources, 30)
    large = [rock for rock in rocks if rock.length >= 52] or list(rocks)
    light = rng.uniform(-0.7, 0.7), rng.uniform(0.3, 0.9)
    spots = _apart(rng, load)
    jobs: list[tuple[float, float, float, bool]] = [(x, y, size, True) for x, y, size in spots]
    for _ in range(load.medium):
        size = load.limit * float(rng.uniform(*load.medium_sizes))
        jobs.append((float(rng.uniform(0, load.width)), float(rng.uniform(0, load.length)), size, False))
    order = rng.permutation(len(jobs))
    # Lumps come last: nothing lies on them but, here and there, a smaller rock.
    jobs = sorted((jobs[k] for k in order), key=lambda job: job[3] and rng.random() < 0.85)
    bodies: list[Body] = []
    for x, y, size, lump in jobs:
        stone = _pick(rng, large if lump else rocks, size)
        cut = cutout(stone, size, rng.uniform(0, 2 * np.pi), bool(rng.integers(2)), rng.uniform(0.75, 1.15))
        if lump:
            cut = _bury(rng, cut)
        bodies += _lay(pixels, cut, (x, y), load, light, lump)
    return Strip(pixels, tuple(bodies))


def quarry(rng: np.random.Generator, sources: Sequence[Piece], load: Load) -> Strip:
    """Stones of all sizes side by side, each laid on those before it; a few are boulders."""
    plan = Quilt(load.width, load.length, 150, (0.5, 0.7), load.limit, evenness=0.8)
    pixels = (quilt(rng, sources, plan).pixels * 0.6).astype(np.uint8)
    rocks = stones(sources, 28)
    large = [rock for rock in rocks if rock.length >= 56] or list(rocks)
    light = rng.uniform(-0.5, 0.5), rng.uniform(0.3, 0.8)
    sizes = _power_law(rng, load)
    spots = _apart(rng, load)
    total = len(sizes)
    # Most boulders lie on top; what comes after them is small and lies around and a little on them.
    boulders = sorted((int(total * rng.uniform(0.5, 0.95)), spot) for spot in spots)
    covered = np.zeros((load.length // 4 + 1, load.width // 4 + 1), np.int16)
    owner = np.zeros((load.length, load.width), np.int16)
    laid: list[tuple[Points, float]] = []
    for k, size in enumerate(sizes):
        while boulders and boulders[0][0] <= k:
            _, (x, y, boulder) = boulders.pop(0)
            stone = _pick(rng, large, boulder)
            cut = cutout(
                stone, boulder, rng.uniform(0, 2 * np.pi), bool(rng.integers(2)), rng.uniform(0.8, 1.1)
            )
            corners = _put(pixels, cut, (x, y), load, light, boulder)
            laid.append((corners, boulder))
            cv2.fillPoly(owner, [rounded(corners)], (len(laid),))
            _count(covered, corners)
        late = k > 0.5 * total
        x, y = _free(rng, covered, owner, load, size, late)
        stone = _pick(rng, rocks, size)
        cut = cutout(
            stone, size, rng.uniform(0, 2 * np.pi), bool(rng.integers(2)), rng.uniform(0.7, 1.15), 0.0
        )
        corners = _put(pixels, cut, (x, y), load, light, size)
        _count(covered, corners)
        clipped = [rounded(corners)]
        if size >= 0.7 * load.limit:
            laid.append((corners, size))
            cv2.fillPoly(owner, clipped, (len(laid),))
        else:
            cv2.fillPoly(owner, clipped, (0,))
    return Strip(pixels, tuple(_shown(laid, owner, load)))


def _power_law(rng: np.random.Generator, load: Load) -> NDArray[np.float64]:
    """Sizes of stones that cover the belt some times, smaller ones later on the whole."""
    low, high = load.least * load.limit, 0.8 * load.limit
    area, sizes = 0.0, []
    power = 1.0 - load.slope
    while area < 2.2 * load.width * load.length:
        u = rng.random(256)
        batch = (low**power + u * (high**power - low**power)) ** (1 / power)
        sizes.append(batch)
        area += float((0.6 * batch**2).sum())
    all_sizes = np.concatenate(sizes)
    late = rng.random(len(all_sizes)) - 0.5 * (all_sizes - low) / (high - low)
    return np.asarray(all_sizes[np.argsort(late)])


def _free(
    rng: np.random.Generator,
    covered: NDArray[np.int16],
    owner: NDArray[np.int16],
    load: Load,
    size: float,
    late: bool,
) -> tuple[float, float]:
    """A place where least lies so far; small stones may lie on a boulder's rim, others keep off it."""
    best, place = np.inf, (0.0, 0.0)
    half = size / 2
    for _ in range(5):
        x, y = float(rng.uniform(0, load.width)), float(rng.uniform(0, load.length))
        a, b, c, d = int(max(y - half, 0)), int(y + half) + 1, int(max(x - half, 0)), int(x + half) + 1
        score = float(covered[a // 4 : b // 4 + 1, c // 4 : d // 4 + 1].mean())
        if late or size > 0.3 * load.limit:
            score += 8.0 * float((owner[a:b:3, c:d:3] > 0).mean())
        if score < best:
            best, place = score, (x, y)
    return place


def _count(covered: NDArray[np.int16], corners: Points) -> None:
    mask = np.zeros(covered.shape, np.uint8)
    low = np.maximum(np.floor(corners.min(axis=0) / 4).astype(int), 0)
    high = np.ceil(corners.max(axis=0) / 4).astype(int) + 1
    part = mask[low[1] : high[1], low[0] : high[0]]
    if part.size:
        part = np.ascontiguousarray(part)
        cv2.fillPoly(part, [rounded(corners / 4 - low)], (1,))
        covered[low[1] : high[1], low[0] : high[0]] += part


def _shown(laid: Sequence[tuple[Points, float]], owner: NDArray[np.int16], load: Load) -> list[Body]:
    bodies = []
    for k, (corners, size) in enumerate(laid, 1):
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        high = np.ceil(corners.max(axis=0)).astype(int) + 1
        window = slice(low[1], high[1]), slice(low[0], high[0])
        if not owner[window].size:
            continue
        mask = np.zeros(owner[window].shape, np.uint8)
        cv2.fillPoly(mask, [rounded(corners - low)], (1,))
        area = cv2.contourArea(corners.astype(np.float32))
        mine = (owner[window] == k) & (mask > 0)
        share = float(mine.sum()) / max(area, 1.0)
        if share < 0.15:
            continue
        inside = np.clip(corners, 0, (load.width - 1, load.length - 1))
        bodies.append(Body(inside, size, cut=share < _SHOWS))
    return bodies


def _apart(rng: np.random.Generator, load: Load) -> list[tuple[float, float, float]]:
    """Middles and sizes of lumps all along the belt, whole on it, none on another."""
    spots: list[tuple[float, float, float]] = []
    for k in range(load.lumps):
        size = load.limit * float(rng.uniform(*load.sizes))
        for _ in range(60):
            margin = size * 0.55
            x = float(rng.uniform(margin, max(load.width - margin, margin + 1)))
            y = float(load.length * (k + rng.uniform(-0.3, 1.3)) / load.lumps)
            if margin < y < load.length - margin and all(
                np.hypot(x - a, y - b) > 0.62 * (size + other) for a, b, other in spots
            ):
                spots.append((x, y, size))
                break
    return spots


def _pick(rng: np.random.Generator, rocks: Sequence[Stone], size: float) -> Stone:
    """A rock, rather one that need not be made larger."""
    for _ in range(4):
        stone = rocks[int(rng.integers(len(rocks)))]
        if stone.length > 0.75 * size:
            break
    return stone


def _bury(rng: np.random.Generator, cut: Cutout) -> Cutout:
    """Fines over a part of its rim, as where a rock sank in."""
    share = float(rng.uniform(0.0, 0.12))
    height, width = cut.alpha.shape
    wave = cv2.GaussianBlur(rng.normal(0, 1, (1, width + 40)).astype(np.float32), (0, 0), 5)[
        0, 20 : width + 20
    ]
    edge = height - 3 - share * height - wave / max(float(wave.std()), 1e-6) * 0.03 * height
    above = np.clip(edge[None, :] - np.arange(height)[:, None], 0, 1).astype(np.float32)
    corners = np.minimum(cut.corners, [[np.inf, float(edge.mean())]])
    return Cutout(cut.pixels, cut.alpha * above, corners)


def _put(
    pixels: Image,
    cut: Cutout,
    middle: tuple[float, float],
    load: Load,
    light: tuple[float, float],
    size: float,
) -> Points:
    x, y = (round(m - side / 2) for m, side in zip(middle, cut.alpha.shape[::-1], strict=True))
    lay(pixels, cut, (x, y), load.shade, float(np.clip(0.07 * size, 0.8, 7.0)), light)
    return np.asarray(np.add(cut.corners, (x, y)))


def _lay(
    pixels: Image,
    cut: Cutout,
    middle: tuple[float, float],
    load: Load,
    light: tuple[float, float],
    lump: bool,
) -> list[Body]:
    corners = _put(pixels, cut, middle, load, light, long_side(cut.corners))
    inside = np.clip(corners, 0, (load.width - 1, load.length - 1))
    return [Body(inside, long_side(inside))] if lump else []
