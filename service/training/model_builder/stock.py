"""What composites are made of: ore with outlines, rocks cut out along theirs, made bodies, frames of real belts."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator import View, body, draw_body, turned
from lumpwatch.service.training.model_builder.split import Part, part_of

Plane = NDArray[Any]
"""A grey picture (h, w), float32."""
Bytes = NDArray[Any]
"""A grey picture or mask (h, w), uint8."""
Ids = NDArray[np.int32]

_ROCK, _AGGLOMERATE = 2, 3
_SIDE = 250
_LEAST_ROCK_PX = 26
SOFT = -1
"""Stands in an id map where a body has no sharp outline: neither ore nor a body to learn from."""


@dataclass(frozen=True, slots=True)
class Ore:
    """A picture of ore with what is outlined in it."""

    grey: Plane
    """(250, 250)"""
    ids: Ids
    """Number of the rock that a pixel belongs to, 0 for none, SOFT for an agglomerate (250, 250)."""
    full: bool
    """Whether ore covers most of it."""


@dataclass(frozen=True, slots=True)
class Cut:
    """A body cut out of its picture."""

    grey: Plane
    mask: Plane
    """1 inside, 0 outside, in between along the outline."""


@dataclass(frozen=True, slots=True)
class Stock:
    """Everything that composites are made of."""

    ore: list[Ore]
    bare: list[Ore]
    """Pictures that show the belt for the most part."""
    rocks: list[Cut]
    made: list[Cut]
    belts: list[Plane]
    """Frames of real belts without large lumps."""


def load_stock(data: Path, part: Part, seed: int, made: int = 240) -> Stock:
    """The stock from the folder of footage; only pictures of one part of belt-ore."""
    ore, rocks = _belt_ore(data / "belt-ore", part)
    rng = np.random.default_rng(seed)
    return Stock(
        ore=[one for one in ore if one.full],
        bare=[one for one in ore if not one.full],
        rocks=rocks,
        made=[_made(rng) for _ in range(made)],
        belts=_frames(data / "belt-cctv" / "limestone.mp4") if part == "train" else [],
    )


def _belt_ore(folder: Path, part: Part) -> tuple[list[Ore], list[Cut]]:
    truth = json.loads((folder / "labels.json").read_text())
    outlines = defaultdict(list)
    for one in truth["annotations"]:
        outlines[one["image_id"]].append(one)
    ore, rocks = [], []
    for image in sorted(truth["images"], key=lambda image: str(image["file_name"])):
        name = Path(image["file_name"]).name
        picture = cv2.imread(str(folder / "images" / name), cv2.IMREAD_GRAYSCALE)
        if picture is None or part_of(name) != part:
            continue
        grey = picture.astype(np.float32)
        ids = np.zeros(grey.shape, np.int32)
        # Small ones last: they lie on large ones.
        found = sorted(outlines[image["id"]], key=lambda one: -float(one["bbox"][2] * one["bbox"][3]))
        covered = 0.0
        for number, one in enumerate(found, start=1):
            if one["category_id"] not in (_ROCK, _AGGLOMERATE):
                continue
            polygon = [np.round(np.array(p).reshape(-1, 2)).astype(np.int32) for p in one["segmentation"]]
            cv2.fillPoly(ids, polygon, number if one["category_id"] == _ROCK else SOFT)
            covered += float(one["bbox"][2] * one["bbox"][3])
            if one["category_id"] == _ROCK:
                rocks += _cut(grey, polygon, one["bbox"])
        ore.append(Ore(grey, ids, full=covered > 9000.0 and _all_ore(grey)))
    return ore, rocks


def _all_ore(grey: Plane) -> bool:
    """Whether hardly any of the dark belt shows."""
    coarse = cv2.GaussianBlur(grey, (0, 0), 8.0)
    return float((coarse < 55.0).mean()) < 0.04


def _cut(grey: Plane, polygon: list[NDArray[np.int32]], bbox: list[float]) -> list[Cut]:
    x, y, w, h = bbox
    if min(w, h) < _LEAST_ROCK_PX or x <= 1 or y <= 1 or x + w >= _SIDE - 1 or y + h >= _SIDE - 1:
        return []
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillPoly(mask, polygon, 255)
    part = (slice(int(y), int(y + h) + 2), slice(int(x), int(x + w) + 2))
    # The outline was drawn by hand, a little outside: half a pixel less.
    inner = cv2.erode(mask, np.ones((3, 3), np.uint8))
    return [Cut(grey[part].copy(), inner[part].astype(np.float32) / 255.0)]


def _made(rng: np.random.Generator) -> Cut:
    kind = ("rock", "rock", "frozen", "smooth", "slab")[int(rng.integers(5))]
    light = rng.normal(size=3) + np.array([0.0, 0.0, 2.0])
    view = View(float(rng.uniform(0.5, 1.5)), light / np.linalg.norm(light))
    shape = draw_body(body(rng, kind), turned(float(rng.uniform(0, 2 * np.pi))), view, 140.0)
    sprite = shape.levels[0]
    mask = sprite[..., 1]
    rows, columns = np.flatnonzero(mask.max(axis=1) > 0.02), np.flatnonzero(mask.max(axis=0) > 0.02)
    part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    body_grey = sprite[..., 0][part] / np.maximum(mask[part], 0.05)
    return Cut(
        (110.0 * body_grey / max(float(body_grey[mask[part] > 0.5].mean()), 1e-3)).astype(np.float32),
        mask[part].astype(np.float32),
    )


def _frames(video: Path, every: int = 12) -> list[Plane]:
    capture = cv2.VideoCapture(str(video))
    frames: list[Plane] = []
    number = 0
    while True:
        read, picture = capture.read()
        if not read:
            return frames
        if number % every == 0:
            frames.append(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32))
        number += 1
