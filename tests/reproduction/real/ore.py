"""The pictures of belt-ore as the frames that they were cut from, with every rock outlined.

The pictures are crops of 250 x 250 pixels from frames on a grid of 7 columns and 3 rows: numbers run up a
column, then on to the next column to the right, and neighbours share 50 pixels. A `Piece` joins the crops of one
frame again, so rocks that crops cut are whole again where both sides are there.

Splits are by frame. Within a split, half 0 and half 1 share no crop: a site learns from one and is judged on
the other.
"""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.training.model_builder.split import Part, part_of

Split = Part
Image = NDArray[np.uint8]
Points = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIDE, STEP = 250, 200
"""Pixels of a crop, and from one crop to the next."""
_ROWS, _ORE_GRID, _BARE_GRID = 3, 21, 12
_ROCK, _AGGLOMERATE, _BELT = 2, 3, 1
_EDGE = 2.0
"""What comes so near to a border, pixels, is cut by it."""
_DARK = 28
_SAME, _COVERED = 0.5, 0.6


@dataclass(frozen=True, slots=True)
class Place:
    """Where a crop comes from."""

    ore: bool
    """A crop of a frame full of ore; else of a bare belt."""
    frame: int
    column: int
    row: int
    """From the top."""


def place_of(name: str) -> Place:
    """The place of a picture by its file name: imagesNNNN of ore, imageNN of bare belt."""
    found = re.fullmatch(r"image(s?)(\d+)\.png", Path(name).name)
    if found is None:
        raise ValueError(f"{name}: not a picture of belt-ore")
    ore, number = bool(found[1]), int(found[2])
    frame, index = divmod(number, _ORE_GRID if ore else _BARE_GRID)
    return Place(ore, frame, index // _ROWS, _ROWS - 1 - index % _ROWS)


@dataclass(frozen=True, slots=True)
class Rock:
    """One outlined rock."""

    corners: Points
    """(n, 2), pixels of its piece."""
    whole: bool
    """All of it is in the piece."""
    length: float
    """The longer side of its upright box."""
    agglomerate: bool = False


@dataclass(frozen=True, slots=True)
class Piece:
    """Crops of one frame, joined."""

    name: str
    pixels: Image
    """BGR (h, w, 3)."""
    ore: Mask
    """Where ore is: no hole, no bare belt (h, w)."""
    rocks: tuple[Rock, ...]
    boxes: Points
    """Left, top, right and bottom of each rock (n, 4)."""


def long_side(corners: Points) -> float:
    """The longer side of the upright box around points."""
    return float(np.ptp(corners, axis=0).max())


@dataclass(frozen=True, slots=True)
class _Crop:
    name: str
    place: Place
    pixels: Image
    rocks: tuple[Rock, ...]
    belts: tuple[Points, ...]


def load(folder: Path, split: Split) -> tuple[_Crop, ...]:
    """The crops of a split, by name."""
    return tuple(crop for crop in _all(folder) if part_of(crop.name) == split)


@cache
def pieces(folder: Path, split: Split, half: int | None = None) -> tuple[Piece, ...]:
    """The frames of ore of a split; of one half only where asked."""
    frames = defaultdict(list)
    for crop in load(folder, split):
        if crop.place.ore:
            frames[crop.place.frame].append(crop)
    halves = _halves({frame: [crop.place.column for crop in crops] for frame, crops in frames.items()})
    found = []
    for frame, crops in sorted(frames.items()):
        mine = [crop for crop in crops if half is None or halves[frame, crop.place.column] == half]
        if mine:
            found.append(join(f"frame {frame}", mine))
    return tuple(found)


def _halves(columns: dict[int, list[int]]) -> dict[tuple[int, int], int]:
    """Half 0 or 1 of each column of each frame: to the left and to the right of where half the crops lie."""
    found = {}
    for frame, all_columns in columns.items():
        middle = sorted(all_columns)[len(all_columns) // 2]
        for column in set(all_columns):
            found[frame, column] = int(column >= middle)
    return found


def bare_belts(folder: Path, split: Split) -> tuple[Image, ...]:
    """Pictures of bare belt of a split."""
    return tuple(crop.pixels for crop in load(folder, split) if not crop.place.ore)


@cache
def _all(folder: Path) -> tuple[_Crop, ...]:
    truth = json.loads((folder / "labels.json").read_text(encoding="utf-8"))
    names = {one["id"]: Path(one["file_name"]).name for one in truth["images"]}
    outlines: dict[str, list[tuple[int, Points]]] = defaultdict(list)
    for one in truth["annotations"]:
        for polygon in one["segmentation"]:
            corners = np.clip(np.array(polygon, float).reshape(-1, 2), 0, SIDE - 1)
            if len(corners) >= 3 and np.ptp(corners, axis=0).min() >= 4:
                outlines[names[one["image_id"]]].append((one["category_id"], corners))
    crops = []
    for name in sorted(names.values()):
        pixels = cv2.imread(str(folder / "images" / name))
        if pixels is None:
            continue
        mine = outlines[name]
        rocks = tuple(
            Rock(corners, _inside(corners, SIDE, SIDE), long_side(corners), kind == _AGGLOMERATE)
            for kind, corners in mine
            if kind in (_ROCK, _AGGLOMERATE)
        )
        belts = tuple(corners for kind, corners in mine if kind == _BELT)
        crops.append(_Crop(name, place_of(name), np.asarray(pixels, np.uint8), rocks, belts))
    return tuple(crops)


def _inside(corners: Points, width: int, height: int) -> bool:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool(low.min() > _EDGE and high[0] < width - 1 - _EDGE and high[1] < height - 1 - _EDGE)


def join(name: str, crops: Sequence[_Crop]) -> Piece:
    """The crops at their places, with the rocks that they share made one."""
    left = min(crop.place.column for crop in crops)
    top = min(crop.place.row for crop in crops)
    shifts = [
        np.array([(crop.place.column - left) * STEP, (crop.place.row - top) * STEP], float) for crop in crops
    ]
    width, height = (int(max(shift[k] for shift in shifts)) + SIDE for k in (0, 1))
    pixels, ore = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.uint8)
    for crop, shift in zip(crops, shifts, strict=True):
        x, y = shift.astype(int)
        pixels[y : y + SIDE, x : x + SIDE] = crop.pixels
        ore[y : y + SIDE, x : x + SIDE] = 1
    for crop, shift in zip(crops, shifts, strict=True):
        for belt in crop.belts:
            cv2.fillPoly(ore, [rounded(belt + shift)], (0,))
    ore[cv2.GaussianBlur(pixels.max(axis=2), (0, 0), 6) < _DARK] = 0
    rocks = tuple(_merged(crops, shifts, (height, width)))
    boxes = [[*rock.corners.min(axis=0), *rock.corners.max(axis=0)] for rock in rocks]
    return Piece(name, pixels, ore.astype(bool), rocks, np.array(boxes, float).reshape(-1, 4))


@dataclass(frozen=True, slots=True)
class _Part:
    rock: Rock
    crop: int
    mask: NDArray[np.bool_]


def _merged(crops: Sequence[_Crop], shifts: Sequence[Points], shape: tuple[int, int]) -> list[Rock]:
    parts = []
    for k, (crop, shift) in enumerate(zip(crops, shifts, strict=True)):
        for rock in crop.rocks:
            corners = rock.corners + shift
            drawn = np.zeros(shape, np.uint8)
            cv2.fillPoly(drawn, [rounded(corners)], (1,))
            parts.append(
                _Part(Rock(corners, rock.whole, rock.length, rock.agglomerate), k, drawn.astype(bool))
            )
    group = list(range(len(parts)))

    def root(k: int) -> int:
        while group[k] != k:
            k = group[k]
        return k

    boxes = np.array([[*p.rock.corners.min(axis=0), *p.rock.corners.max(axis=0)] for p in parts])
    for a in range(len(parts)):
        near = np.all(boxes[a, :2] <= boxes[a + 1 :, 2:], axis=1)
        near &= np.all(boxes[a, 2:] >= boxes[a + 1 :, :2], axis=1)
        for b in a + 1 + np.flatnonzero(near):
            if parts[a].crop != parts[b].crop and _shared(parts[a], parts[b], shifts) > _SAME:
                group[root(int(b))] = root(a)
    members = defaultdict(list)
    for k in range(len(parts)):
        members[root(k)].append(k)
    whole: list[tuple[Rock, Mask]] = []
    cut: list[tuple[Rock, Mask]] = []
    for mine in members.values():
        rock, mask = _union([parts[k] for k in mine], shifts)
        (whole if rock.whole else cut).append((rock, mask))
    taken, kept = np.zeros(shape, bool), []
    for found in (whole, cut):
        # Two people's outlines of one rock: the larger stays.
        for rock, mask in sorted(found, key=lambda one: -int(one[1].sum())):
            if mask.any() and taken[mask].mean() < _COVERED:
                kept.append(rock)
                taken |= mask
    return kept


def _shared(a: _Part, b: _Part, shifts: Sequence[Points]) -> float:
    """Intersection over union of two outlines where both their crops look."""
    low = np.maximum(shifts[a.crop], shifts[b.crop]).astype(int)
    high = np.minimum(shifts[a.crop], shifts[b.crop]).astype(int) + SIDE
    if np.any(high <= low):
        return 0.0
    window = slice(low[1], high[1]), slice(low[0], high[0])
    one, other = a.mask[window], b.mask[window]
    both, least = (one & other).sum(), min(one.sum(), other.sum())
    either = (one | other).sum()
    return float(max(both / either, both / least - 0.2)) if least >= 20 else 0.0


def _union(parts: Sequence[_Part], shifts: Sequence[Points]) -> tuple[Rock, Mask]:
    agglomerate = all(part.rock.agglomerate for part in parts)
    whole = [part for part in parts if part.rock.whole]
    if whole:
        best = max(whole, key=lambda part: part.mask.sum())
        return Rock(best.rock.corners, True, best.rock.length, agglomerate), best.mask
    mask = parts[0].mask.copy()
    for part in parts[1:]:
        mask |= part.mask
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    corners = np.asarray(max(outlines, key=cv2.contourArea), float).reshape(-1, 2)
    # Whole where each side of a crop that cuts one part is inside the crop of another part.
    complete = len(parts) > 1 and all(
        any(_holds(shifts[other.crop], point) for other in parts if other.crop != part.crop)
        for part in parts
        for point in part.rock.corners
        if not _holds(shifts[part.crop], point)
    )
    return Rock(corners, complete, long_side(corners), agglomerate), mask


def _holds(shift: Points, point: Points) -> bool:
    inside = point - shift
    return bool(inside.min() > _EDGE and inside.max() < SIDE - 1 - _EDGE)


def rounded(points: Points) -> NDArray[np.int32]:
    """Whole pixels, as OpenCV draws polygons."""
    return np.asarray(np.round(points), np.int32)
