"""Belts seen from above: ore of many kinds with bodies on it, and which pixel belongs to which body."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lumpwatch.service.training.model_builder.stock import SOFT, Cut, Ids, Ore, Plane, Stock
from lumpwatch.service.training.model_builder.stones import any_stone

WIDTH, HEIGHT = 620, 860
_LUMP = (0.95, 2.0)
_MEDIUM = (0.15, 0.72)


@dataclass(slots=True)
class Belt:
    """A belt from above while it is made."""

    grey: Plane
    ids: Ids
    """Number of the body that a pixel belongs to; 0: ore, SOFT: a body without an outline."""
    limit: float
    """Longest side from which a body is a lump, px of this picture."""
    bodies: int = 0

    def lay(self, stone: Cut, y: int, x: int, rng: np.random.Generator, shadow: float) -> None:
        """Put a body down with its upper left corner at y, x; `shadow`: how dark the one it casts is."""
        h, w = stone.mask.shape
        reach = max(2, int(0.08 * max(h, w)))
        if shadow > 0.0:
            wide = cv2.copyMakeBorder(stone.mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT)
            dark = cv2.GaussianBlur(wide, (0, 0), 0.5 * reach + 0.3)
            dy, dx = (int(v) for v in np.round(reach * rng.uniform(-0.9, 0.9, 2)))
            view = _overlap(self.grey.shape, dark.shape, y - reach + dy, x - reach + dx)
            if view is not None:
                there, here = view
                self.grey[there] *= 1.0 - shadow * dark[here]
        view = _overlap(self.grey.shape, (h, w), y, x)
        if view is None:
            return
        there, here = view
        mask = stone.mask[here]
        self.grey[there] += mask * (stone.grey[here] - self.grey[there])
        self.bodies += 1
        self.ids[there][mask > 0.5] = self.bodies


def make_belt(stock: Stock, rng: np.random.Generator) -> Belt:
    """A belt with anything on it."""
    limit = float(np.exp(rng.uniform(np.log(58.0), np.log(150.0))))
    kind = rng.choice(5, p=(0.42, 0.20, 0.20, 0.10, 0.08))
    if kind == 0:
        scale = limit * float(np.exp(rng.uniform(np.log(0.0016), np.log(0.0085))))
        belt = quilt(stock, rng, scale, limit)
        if rng.random() < 0.3:
            mix(belt, quilt(stock, rng, scale * rng.uniform(0.5, 1.5), limit), rng)
    elif kind == 1:  # real ore as it is, its own rocks for lumps
        return quilt(stock, rng, limit * rng.uniform(0.009, 0.019), limit)
    elif kind == 2:  # stones of all sizes side by side
        belt = leaves(stock, rng, limit, limit * float(np.exp(rng.uniform(np.log(0.3), np.log(1.6)))))
        if rng.random() < 0.5:
            return belt
    elif kind == 3:
        belt = gravel(rng, limit)
    else:
        belt = bare(stock, rng, limit)
    if rng.random() < 0.4:
        mottle(belt, rng)
    scatter(belt, stock, rng)
    return belt


def mottle(belt: Belt, rng: np.random.Generator) -> None:
    """Patches of other brightness without outlines: wet, dry, dusty, of other fines. They are no bodies."""
    depth = rng.uniform(0.08, 0.5)
    belt.grey *= 1.0 + depth * (_patches(belt.limit, rng) - 0.5)


def mix(belt: Belt, other: Belt, rng: np.random.Generator) -> None:
    """Patches of another ore; where they meet nothing is known of bodies."""
    share = _patches(belt.limit, rng)
    belt.grey += share * (other.grey - belt.grey)
    belt.ids[other.ids > 0] = SOFT
    belt.ids[(share > 0.15) & (belt.ids > 0)] = SOFT


def _patches(limit: float, rng: np.random.Generator) -> Plane:
    """0 to 1 in patches about as large as bodies, with soft borders."""
    size = limit * float(np.exp(rng.uniform(np.log(0.15), np.log(1.2))))
    cells = max(4, int(HEIGHT / size)), max(4, int(WIDTH / size))
    noise = cv2.resize(
        rng.standard_normal(cells).astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC
    )
    soft = np.tanh((noise - rng.uniform(-0.5, 1.0)) * rng.uniform(0.7, 2.5))
    return (0.5 + 0.5 * soft).astype(np.float32)


def scatter(belt: Belt, stock: Stock, rng: np.random.Generator) -> None:
    """Medium rocks, some of them touching, and lumps, in any order."""
    mediums = 0 if rng.random() < 0.2 else int(rng.integers(1, 26))
    lumps = 0 if rng.random() < 0.12 else int(rng.integers(1, 6))
    ground = belt.grey.copy()
    tone = float(np.median(ground))
    alike = rng.uniform(0.0, 1.0)
    for lump in rng.permutation(np.repeat([True, False], [lumps, mediums])):
        length = belt.limit * rng.uniform(*(_LUMP if lump else _MEDIUM))
        y, x = (
            int(rng.uniform(-0.5 * length, HEIGHT - 0.5 * length)),
            int(rng.uniform(-0.2 * length, WIDTH - 0.8 * length)),
        )
        if lump or rng.random() < 0.6:
            _put(belt, any_stone(stock, length, rng, ground), y, x, tone, alike, rng)
            continue
        for _ in range(int(rng.integers(2, 6))):  # a group that touches
            stone = any_stone(stock, length * rng.uniform(0.7, 1.2), rng, ground)
            _put(belt, stone, y, x, tone, alike, rng)
            angle = rng.uniform(0, 2 * np.pi)
            y, x = y + int(0.85 * length * np.sin(angle)), x + int(0.85 * length * np.cos(angle))


def _put(belt: Belt, stone: Cut, y: int, x: int, tone: float, alike: float, rng: np.random.Generator) -> None:
    inner = stone.mask > 0.5
    if not inner.any():
        return
    own = float(stone.grey[inner].mean())
    # Mostly as bright as the ore around; `alike` says how much so on this belt.
    wanted = tone * float(np.exp(rng.normal(0.06, 0.05 + 0.28 * (1.0 - alike))))
    contrast = rng.uniform(0.5, 1.2)
    grey = wanted + contrast * (stone.grey - own) * wanted / max(own, 20.0)
    mask = stone.mask
    if rng.random() < 0.15:  # covered with fines here and there
        h, w = mask.shape
        fines = cv2.resize(rng.random((5, 5)).astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC)
        cover = np.clip((fines - rng.uniform(0.3, 0.7)) * rng.uniform(3, 12), 0, 1)
        source_y, source_x = (
            int(rng.integers(HEIGHT - min(h, HEIGHT) + 1)),
            int(rng.integers(WIDTH - min(w, WIDTH) + 1)),
        )
        part = belt.grey[source_y : source_y + h, source_x : source_x + w]
        if part.shape == grey.shape:
            grey = grey + cover * (part - grey)
    if rng.random() < 0.12:  # partly buried
        h, w = mask.shape
        side = int(rng.integers(4))
        line = rng.uniform(0.15, 0.45) + 0.04 * np.cumsum(rng.standard_normal(max(h, w)))
        ramp = (
            np.clip((np.arange(h)[:, None] / h - line[:w][None, :]) * h, 0, 1)
            if side % 2
            else np.clip((np.arange(w)[None, :] / w - line[:h][:, None]) * w, 0, 1)
        )
        if side >= 2:
            ramp = ramp[::-1, ::-1]
        mask = (mask * ramp).astype(np.float32)
    shadow = 0.0 if rng.random() < 0.15 else rng.uniform(0.1, 0.75)
    belt.lay(Cut(grey.astype(np.float32), mask), y, x, rng, shadow)


def quilt(stock: Stock, rng: np.random.Generator, scale: float, limit: float) -> Belt:
    """Real ore without end: pictures `scale` times as large side by side, joined by narrow seams."""
    side = max(20, int(250 * scale))
    step = max(8, int(side * rng.uniform(0.55, 0.8)))
    chosen = [stock.ore[int(k)] for k in rng.integers(len(stock.ore), size=int(rng.integers(2, 9)))]
    mean = float(np.mean([one.grey.mean() for one in chosen]))
    sized = []
    for one in chosen:
        sized += [_sized(one, side, turn, bool(rng.integers(2)), mean) for turn in range(4)]
    belt = Belt(np.full((HEIGHT, WIDTH), mean, np.float32), np.zeros((HEIGHT, WIDTH), np.int32), limit)
    feather = _feather(side)
    places = [(y, x) for y in range(-side // 2, HEIGHT, step) for x in range(-side // 2, WIDTH, step)]
    for k in rng.permutation(len(places)):
        y, x = places[int(k)]
        y, x = (
            y + int(rng.integers(-step // 4 - 1, step // 4 + 1)),
            x + int(rng.integers(-step // 4 - 1, step // 4 + 1)),
        )
        tile = sized[int(rng.integers(len(sized)))]
        view = _overlap(belt.grey.shape, (side, side), y, x)
        if view is None:
            continue
        there, here = view
        weight = feather[here]
        belt.grey[there] += weight * (tile.grey[here] - belt.grey[there])
        hard = weight > 0.5
        ids = tile.ids[here]
        belt.ids[there][hard] = np.where(ids > 0, ids + belt.bodies, ids)[hard]
        belt.bodies += int(tile.ids.max(initial=0)) if side > 60 else 0
        if side <= 60:
            belt.ids[there][hard] = 0
    return belt


def _sized(one: Ore, side: int, turn: int, mirror: bool, mean: float) -> Ore:
    grey, ids = np.rot90(one.grey, turn), np.rot90(one.ids, turn)
    if mirror:
        grey, ids = grey[:, ::-1], ids[:, ::-1]
    way = cv2.INTER_AREA if side < 250 else cv2.INTER_CUBIC
    scaled = cv2.resize(np.ascontiguousarray(grey), (side, side), interpolation=way).astype(np.float32)
    scaled *= (mean / max(float(scaled.mean()), 1.0)) ** 0.8
    numbers = cv2.resize(
        np.ascontiguousarray(ids).astype(np.float32), (side, side), interpolation=cv2.INTER_NEAREST
    )
    return Ore(scaled, np.round(numbers).astype(np.int32), one.full)


def _feather(side: int) -> Plane:
    seam = max(2.0, (0.05 if side > 150 else 0.14) * side)
    ramp = np.clip(np.minimum(np.arange(1, side + 1), np.arange(side, 0, -1)) / seam, 0, 1)
    return np.minimum.outer(ramp, ramp).astype(np.float32)


def leaves(stock: Stock, rng: np.random.Generator, limit: float, largest: float) -> Belt:
    """Stones of all sizes laid over each other, sizes by a power law up to `largest` (dead leaves).

    Lee, Mumford, Huang, Occlusion models for natural images (2001).
    """
    tone = rng.uniform(60.0, 170.0)
    base = gravel(rng, limit, tone)
    belt = Belt(base.grey, base.ids, limit)
    smallest = max(7.0, 0.06 * limit)
    power = rng.uniform(1.2, 3.2)
    spread, alike = rng.uniform(0.05, 0.35), rng.uniform(0.0, 1.0)
    # Enough to cover the belt about twice, drawn in bands of size so that each gets its share of the area.
    lengths: list[float] = []
    area, wanted = 0.0, rng.uniform(0.8, 2.0) * WIDTH * HEIGHT
    while area < wanted and len(lengths) < 1500:
        u = rng.random()
        low, high = smallest ** (1 - power), largest ** (1 - power)
        length = float((low + u * (high - low)) ** (1.0 / (1.0 - power)))
        lengths.append(length)
        area += 0.5 * length * length
    order = np.array(lengths)
    if rng.random() < 0.6:  # large ones lie on top: small ones fall between
        order = np.sort(order * np.exp(0.5 * rng.standard_normal(len(order))))
        order = np.clip(order, smallest, largest)
    pool = [
        any_stone(stock, float(size), rng, belt.grey)
        for size in np.geomspace(smallest, largest, 40)
        for _ in range(3)
    ]
    sizes = np.array([max(one.mask.shape) for one in pool], np.float64)
    shadow = rng.uniform(0.1, 0.7)
    for length in order:
        near = np.argsort(np.abs(np.log(sizes / length)), kind="stable")[:9]
        stone = pool[int(near[int(rng.integers(len(near)))])]
        inner = stone.mask > 0.5
        if not inner.any():
            continue
        own = max(float(stone.grey[inner].mean()), 20.0)
        factor = tone * float(np.exp(rng.normal(0.0, spread * (1.3 - alike)))) / own
        turned = (
            Cut(
                np.ascontiguousarray(np.rot90(stone.grey * factor, 2)),
                np.ascontiguousarray(np.rot90(stone.mask, 2)),
            )
            if rng.random() < 0.5
            else Cut(stone.grey * factor, stone.mask)
        )
        y, x = int(rng.uniform(-length, HEIGHT)), int(rng.uniform(-length, WIDTH))
        belt.lay(turned, y, x, rng, shadow if rng.random() < 0.8 else 0.0)
    return belt


def gravel(rng: np.random.Generator, limit: float, tone: float | None = None) -> Belt:
    """Fine ore as noise of one or two scales, with cells as of grains or without."""
    tone = rng.uniform(50.0, 180.0) if tone is None else tone
    grain = rng.uniform(2.0, 0.12 * limit)
    field = np.zeros((HEIGHT, WIDTH), np.float32)
    for factor, weight in ((1.0, 1.0), (2.3, rng.uniform(0.0, 0.8)), (6.0, rng.uniform(0.0, 0.5))):
        size = max(4, int(WIDTH / (grain * factor))), max(4, int(HEIGHT / (grain * factor)))
        noise = cv2.resize(
            rng.standard_normal((size[1], size[0])).astype(np.float32),
            (WIDTH, HEIGHT),
            interpolation=cv2.INTER_CUBIC,
        )
        field += weight * (np.abs(noise) if rng.random() < 0.5 else noise)
    field -= field.mean()
    field *= tone * rng.uniform(0.03, 0.35) / float(field.std())
    return Belt(np.clip(tone + field, 0, 255).astype(np.float32), np.zeros((HEIGHT, WIDTH), np.int32), limit)


def bare(stock: Stock, rng: np.random.Generator, limit: float) -> Belt:
    """A real belt without large lumps, or a bare one."""
    if stock.belts and rng.random() < 0.6:
        frame = stock.belts[int(rng.integers(len(stock.belts)))]
        h, w = frame.shape
        height = int(h * rng.uniform(0.5, 1.0))
        width = min(w, max(60, int(height * WIDTH / HEIGHT * rng.uniform(0.8, 1.6))))
        y, x = int(rng.integers(h - height + 1)), int(rng.integers(w - width + 1))
        part = frame[y : y + height, x : x + width]
    else:
        part = np.rot90(stock.bare[int(rng.integers(len(stock.bare)))].grey, int(rng.integers(4)))
    grey = cv2.resize(np.ascontiguousarray(part), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC).astype(
        np.float32
    )
    return Belt(grey, np.zeros((HEIGHT, WIDTH), np.int32), limit)


Window = tuple[slice, slice]


def _overlap(shape: tuple[int, ...], size: tuple[int, ...], y: int, x: int) -> tuple[Window, Window] | None:
    """Where a patch of `size` at y, x lies in a picture of `shape`, and the part of it that does."""
    a, b, c, d = max(0, y), min(shape[0], y + size[0]), max(0, x), min(shape[1], x + size[1])
    if a >= b or c >= d:
        return None
    return (slice(a, b), slice(c, d)), (slice(a - y, b - y), slice(c - x, d - x))


__all__ = ["SOFT", "Belt", "make_belt"]
