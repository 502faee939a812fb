"""What a still camera sees where nothing moves: the background as training saw it.

A background model that starts on a busy place takes who stands there for background, and leaves a hole where
he was when he goes. One that is first shown the empty scene does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.models.trackers.foreground import Foreground

SHOWN = 40
"""Pictures of the empty scene that a background model is shown."""
LEAST_SPREAD = 6.0
"""Grey levels that a pixel varies by at least: compression and light change more than a median shows."""
LEAST_SEEN = 3
"""Pictures in which a place must be unoccupied for it to be learned from those alone."""
CORE = (0.6, 0.85)
"""Part of the width and height of a labelled box that is its object's body."""
LEAST_THERE, MOST_SEEN = 6, 0.15
"""Boxes that must have lain on a place, and the share of them in which it may be foreground, for it to be scenery."""
_CHANGED = 40.0
_MOST_CHANGED = 0.5


@dataclass(frozen=True, slots=True)
class EmptyScene:
    """Median and spread of a region's pictures."""

    picture: Image
    """BGR (h, w, 3)."""
    spread: Image
    """Standard deviation of each value, grey levels (h, w, 3)."""
    cover: Image | None = None
    """Not 0 where scenery stands before whatever passes, a post or a sign (h, w); None: not known."""

    def sized(self, shape: tuple[int, int]) -> EmptyScene:
        """The same for pictures of that height and width."""
        if self.picture.shape[:2] == shape:
            return self
        size = (shape[1], shape[0])
        picture, spread = (
            np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA), np.uint8)
            for one in (self.picture, self.spread)
        )
        return EmptyScene(picture, spread, self.covering(shape))

    def covering(self, shape: tuple[int, int]) -> Image | None:
        """The cover for pictures of that height and width, 0 or 1."""
        if self.cover is None:
            return None
        size = (shape[1], shape[0])
        return np.asarray(cv2.resize(self.cover, size, interpolation=cv2.INTER_NEAREST) != 0, np.uint8)

    def is_of(self, picture: Image) -> bool:
        """Whether a BGR picture (h, w, 3) shows this place in about this light: most of it is as it was."""
        change = np.abs(picture.astype(np.float32) - self.picture).max(axis=2)
        return float((change > _CHANGED).mean()) < _MOST_CHANGED


def learn_scene(pictures: Sequence[Image], occupied: Sequence[Image] = ()) -> EmptyScene:
    """The scene behind whatever moves, from BGR pictures (h, w, 3) that are some seconds apart.

    `occupied` (h, w) is not 0 where a picture shows something that does not belong to the scene: a person who stands
    for most of the clip is not taken for a part of it. Where fewer than `LEAST_SEEN` pictures show the place itself,
    all count. The spread is 1.4826 times the median absolute deviation. Raises ValueError without pictures, and for
    another number of masks than of pictures.
    """
    if not pictures:
        raise ValueError("no pictures to learn an empty scene from")
    if occupied and len(occupied) != len(pictures):
        raise ValueError(f"{len(occupied)} masks for {len(pictures)} pictures")
    stack = np.stack(pictures)
    if not occupied:
        median = np.median(stack, axis=0).astype(np.uint8)
        deviation = np.median(_apart(stack, median), axis=0)
    else:
        away = np.stack(occupied) != 0
        away &= (~away).sum(axis=0) >= LEAST_SEEN
        median = _median_without(stack, away).astype(np.uint8)
        deviation = _median_without(_apart(stack, median), away)
    return EmptyScene(median, np.clip(np.ceil(1.4826 * deviation), 0, 255).astype(np.uint8))


class CoverCounts:
    """Finds scenery in the foreground: where labelled objects were often, and never seen."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._there, self._seen = np.zeros((2, *shape), np.int32)

    def add(self, mask: Image, boxes: NDArray[np.float64]) -> None:
        """Count the foreground mask (h, w) of a picture in its labelled boxes (n, 4): centre, width and height."""
        for box in boxes:
            core = scaled_box(box, CORE)
            self._there[core] += 1
            self._seen[core] += mask[core] != 0

    def cover(self) -> Image | None:
        """The cover (h, w), 0 or 1; None where there is none."""
        found = (self._there >= LEAST_THERE) & (self._seen < MOST_SEEN * self._there)
        return found.astype(np.uint8) if found.any() else None


def scaled_box(box: NDArray[np.float64], times: tuple[float, float]) -> tuple[slice, slice]:
    """Rows and columns of a box (centre, width and height) that is so many times as wide and as high."""
    x, y, w, h = box
    (left, top), (right, bottom) = (
        (round(max(x + side * times[0] * w / 2, 0)), round(max(y + side * times[1] * h / 2, 0)))
        for side in (-1, 1)
    )
    return slice(top, bottom), slice(left, right)


def _median_without(stack: Image, away: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Median over pictures (n, h, w, 3), but for those `away` (n, h, w): half of them go to either end."""
    ends = np.where(np.cumsum(away, axis=0) % 2 == 0, np.uint8(255), np.uint8(0))
    return np.asarray(np.median(np.where(away[..., None], ends[..., None], stack), axis=0))


def _apart(stack: Image, picture: Image) -> Image:
    """|stack - picture| of uint8 pictures (n, h, w, 3) without overflow."""
    return np.maximum(stack, picture) - np.minimum(stack, picture)


def show(scene: EmptyScene, foreground: Foreground, rng: np.random.Generator) -> None:
    """Let a new background model learn the empty scene, as it varies."""
    spread = np.maximum(scene.spread, LEAST_SPREAD)
    for _ in range(SHOWN):
        drawn = scene.picture + spread * rng.standard_normal(scene.picture.shape, dtype=np.float32)
        foreground.apply(np.clip(np.round(drawn), 0, 255).astype(np.uint8))
