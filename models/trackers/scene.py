"""What a still camera sees where nothing moves: the background as training saw it.

A background model that starts on a busy place takes who stands there for background, and leaves a hole where
he was when he goes. One that is first shown the empty scene does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from lumpwatch.models.roi import Image
from lumpwatch.models.trackers.foreground import Foreground

SHOWN = 40
"""Pictures of the empty scene that a background model is shown."""
LEAST_SPREAD = 6.0
"""Grey levels that a pixel varies by at least: compression and light change more than a median shows."""
_CHANGED = 40.0
_MOST_CHANGED = 0.5


@dataclass(frozen=True, slots=True)
class EmptyScene:
    """Median and spread of a region's pictures."""

    picture: Image
    """BGR (h, w, 3)."""
    spread: Image
    """Standard deviation of each value, grey levels (h, w, 3)."""

    def sized(self, shape: tuple[int, int]) -> EmptyScene:
        """The same for pictures of that height and width."""
        if self.picture.shape[:2] == shape:
            return self
        size = (shape[1], shape[0])
        picture, spread = (
            np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA), np.uint8)
            for one in (self.picture, self.spread)
        )
        return EmptyScene(picture, spread)

    def is_of(self, picture: Image) -> bool:
        """Whether a BGR picture (h, w, 3) shows this place in about this light: most of it is as it was."""
        change = np.abs(picture.astype(np.float32) - self.picture).max(axis=2)
        return float((change > _CHANGED).mean()) < _MOST_CHANGED


def learn_scene(pictures: Sequence[Image]) -> EmptyScene:
    """The scene behind whatever moves, from BGR pictures (h, w, 3) that are some seconds apart.

    The spread is 1.4826 times the median absolute deviation. Raises ValueError without pictures.
    """
    if not pictures:
        raise ValueError("no pictures to learn an empty scene from")
    stack = np.stack(pictures)
    median = np.median(stack, axis=0).astype(np.uint8)
    deviation = np.median(_apart(stack, median), axis=0)
    return EmptyScene(median, np.clip(np.ceil(1.4826 * deviation), 0, 255).astype(np.uint8))


def _apart(stack: Image, picture: Image) -> Image:
    """|stack - picture| of uint8 pictures (n, h, w, 3) without overflow."""
    return np.maximum(stack, picture) - np.minimum(stack, picture)


def show(scene: EmptyScene, foreground: Foreground, rng: np.random.Generator) -> None:
    """Let a new background model learn the empty scene, as it varies."""
    spread = np.maximum(scene.spread, LEAST_SPREAD)
    for _ in range(SHOWN):
        drawn = scene.picture + spread * rng.standard_normal(scene.picture.shape, dtype=np.float32)
        foreground.apply(np.clip(np.round(drawn), 0, 255).astype(np.uint8))
