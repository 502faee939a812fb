"""Pictures to learn from with their truth, by seed: composites, and feeds of the project's simulator."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from lumpwatch.service.training.model_builder.camera import HEIGHT, WIDTH, develop, shoot
from lumpwatch.service.training.model_builder.faint import without_faint
from lumpwatch.service.training.model_builder.scene import make_belt
from lumpwatch.service.training.model_builder.split import Part
from lumpwatch.service.training.model_builder.stock import Bytes, Ids, Stock, load_stock
from lumpwatch.service.training.model_builder.truth import Truth, truth_of

_MOST_WHITE = 0.35
_LEAST_CONTRAST = 3.0


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture to learn from."""

    grey: Bytes
    """(240, 320)"""
    truth: Truth
    inside: Bytes
    """1 on the belt, by cell (60, 80)."""
    limit_px: NDArray[np.float32]
    """How long a body at the limit is, by row (240,)."""


def composites(stock: Stock, seed: int, count: int) -> Iterator[Picture]:
    """Composites of real ore, made ore and bodies; those in which nothing can be seen are left out."""
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        belt = make_belt(stock, rng)
        for _ in range(2):  # a belt costs more than a look at it
            shot = shoot(belt, rng)
            on_belt = shot.grey[shot.inside > 0]
            if len(on_belt) < 5000 or (on_belt > 250).mean() > _MOST_WHITE or on_belt.std() < _LEAST_CONTRAST:
                continue
            made += 1
            ids = without_faint(shot.grey, shot.ids)
            yield Picture(shot.grey, truth_of(ids), _cells(shot.inside), shot.limit_px)


_LUMPS: dict[str, object] = {
    "smallest_lump": 1.0, "largest_lump": 2.2, "lumps_per_minute": 24.0, "lump_spacing_s": 1.0, "cluster_share": 0.3,
    "dust": 0.3, "frozen_share": 0.3, "smooth_share": 0.2, "slab_share": 0.1, "buried_share": 0.2,
    "near_limit_rocks_per_minute": 6.0,
}  # fmt: skip
_LOOKS: tuple[dict[str, object], ...] = (
    {},
    {"dust": 0.6, "medium_rocks_per_minute": 140.0},
    {"lump_contrast": 0.3},
    {"night": 0.6, "noise": 4.0},
    {"lump_contrast": 0.6, "dust": 0.5},
    {"frozen_share": 0.8, "smooth_share": 0.1, "slab_share": 0.1},
    {"rain": 0.4, "steam": 0.3},
    {"touching_share": 0.5, "medium_rocks_per_minute": 200.0},
)


def simulated(seed: int, count: int) -> Iterator[Picture]:
    """Pictures of feeds of both styles, some as another camera might show them."""
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        look = _LOOKS[int(rng.integers(len(_LOOKS)))]
        style = "ab"[int(rng.integers(2))]
        spec = FeedSpec.model_validate({"seed": int(rng.integers(1 << 30)), "style": style, **_LUMPS, **look})
        feed = FeedSimulator(spec)
        feed.skip(60)
        for _ in range(min(12, count - made)):
            feed.skip(int(rng.integers(15, 40)))
            yield _seen(feed, rng)
            made += 1


def _seen(feed: FeedSimulator, rng: np.random.Generator) -> Picture:
    spec, t = feed.spec, feed.time_s
    ids = _bodies(feed, t)
    picture, _ = feed.render()
    outline = np.array(feed.polygon) * (spec.width, spec.height)
    mask = np.zeros((spec.height, spec.width), np.uint8)
    cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1)
    # A region's box, as the product cuts it, with some room; cut to the shape of a working picture.
    zoom = rng.uniform(0.8, 1.0)
    w, h = int(spec.width * zoom), int(spec.height * zoom)
    x, y = int(rng.integers(spec.width - w + 1)), int(rng.integers(spec.height - h + 1))
    part = (slice(y, y + h), slice(x, x + w))
    size = (WIDTH, HEIGHT)
    numbers = cv2.resize(ids[part].astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
    inside = cv2.resize(mask[part], size, interpolation=cv2.INTER_NEAREST)
    fine = cv2.resize(picture[part].astype(np.float32), (2 * WIDTH, 2 * HEIGHT), interpolation=cv2.INTER_AREA)
    grey = (
        develop(fine, rng)
        if rng.random() < 0.5
        else np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), np.uint8)
    )
    rows = np.linspace(y, y + h, HEIGHT)
    scale = np.abs(
        np.array([feed.geometry.project(0.0, yy, 0.0)[1:] for yy in np.linspace(0, spec.belt_length_mm, 40)])
    )
    limit = np.interp(rows, scale[:, 0], scale[:, 1]) * spec.limit_mm * HEIGHT / h
    return Picture(
        grey, truth_of(np.round(numbers).astype(np.int32)), _cells(inside), limit.astype(np.float32)
    )


def _bodies(feed: FeedSimulator, t: float) -> Ids:
    """Which rock a pixel belongs to."""
    spec, geometry = feed.spec, feed.geometry
    ids = np.zeros((spec.height, spec.width), np.int32)
    for number, rock in enumerate(feed._traffic.at(t), start=1):
        u, v, scale = geometry.project(rock.x, rock.y, rock.z)
        size = rock.size_mm * scale
        sprite = rock.shape.levels[0]
        zoom = size / rock.shape.texels
        reach = zoom * sprite.shape[0] / 2
        x0, y0 = max(int(u - reach), 0), max(int(v - reach), 0)
        x1, y1 = min(int(u + reach) + 2, spec.width), min(int(v + reach) + 2, int(geometry.rim_row))
        if x1 <= x0 or y1 <= y0:
            continue
        corner = zoom * (0.5 - sprite.shape[0] / 2) - 0.5
        matrix = np.array([[zoom, 0, u - x0 + corner], [0, zoom, v - y0 + corner]])
        mask = cv2.warpAffine(np.ascontiguousarray(sprite[..., 1]), matrix, (x1 - x0, y1 - y0))
        ids[y0:y1, x0:x1][mask > 0.5] = number
    return ids


def _cells(inside: Bytes) -> Bytes:
    return np.ascontiguousarray(inside[2::4, 2::4])


@dataclass(frozen=True, slots=True)
class Task:
    """A file of pictures to make."""

    data: Path
    part: Part
    kind: str
    seed: int
    count: int
    out: Path


def make(task: Task) -> None:
    """Make the pictures of a task and write them."""
    cv2.setNumThreads(1)
    if task.kind == "simulated":
        pictures = list(simulated(task.seed, task.count))
    else:
        stock = load_stock(task.data, task.part, task.seed)
        pictures = list(composites(stock, task.seed, task.count))
    counts = [len(one.truth.boxes) for one in pictures]
    with task.out.open("wb") as file:
        np.savez(
            file,
            grey=np.stack([one.grey for one in pictures]),
            body=np.stack([one.truth.body for one in pictures]),
            edge=np.stack([one.truth.edge for one in pictures]),
            sides=np.stack([one.truth.sides for one in pictures]),
            inside=np.stack([one.inside for one in pictures]),
            limit=np.stack([one.limit_px for one in pictures]),
            boxes=np.concatenate([one.truth.boxes for one in pictures]),
            counts=np.array(counts),
        )
