"""What else a player does to decoded planes: grey levels to full range, pixels to squares."""

from __future__ import annotations

from fractions import Fraction

import cv2
import numpy as np
from av import VideoFrame
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

from lumpwatch.service.config import Levels

Plane = NDArray[np.uint8]

_NEARLY_SQUARE = 0.01
_LARGEST_ASPECT = 4.0
_BLACK, _STRETCH = 16.0, 255.0 / 219.0


def is_limited(picture: VideoFrame, levels: Levels) -> bool:
    """Whether black is 16 and white 235: as configured, or as the picture says; one that says nothing is taken as it
    is.
    """
    if levels != "auto":
        return levels == "limited"
    return int(picture.color_range) == int(ColorRange.MPEG.value)


def full_range(luma: Plane) -> Plane:
    """Luma of limited range in full range, where black is 0 and white 255."""
    # A weighted sum that is rounded and limited: half the time of a table, and no level lies near a half.
    return np.asarray(cv2.addWeighted(luma, _STRETCH, luma, 0.0, -_BLACK * _STRETCH), np.uint8)


def usable_aspect(aspect: Fraction | None) -> float:
    """Width of a pixel over its height; 1 where it is not said, nearly so, or none that any camera has."""
    if not aspect:
        return 1.0
    value = float(aspect)
    odd = not 1 / _LARGEST_ASPECT <= value <= _LARGEST_ASPECT or abs(value - 1.0) < _NEARLY_SQUARE
    return 1.0 if odd else value


def squared(plane: Plane, aspect: float) -> Plane:
    """A plane (h, w) with square pixels: wider or higher, with even sides where they were even."""
    height, width = plane.shape
    size = (_stretched(width, aspect), height) if aspect > 1.0 else (width, _stretched(height, 1.0 / aspect))
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def squared_i420(packed: Plane, aspect: float) -> Plane:
    """The same of packed planes (h * 3 / 2, w) with even sides."""
    height, width = packed.shape[0] * 2 // 3, packed.shape[1]
    luma = squared(packed[:height], aspect)
    half = luma.shape[1] // 2, luma.shape[0] // 2
    chroma = packed[height:].reshape(2, height // 2, width // 2)
    parts = [cv2.resize(plane, half, interpolation=cv2.INTER_LINEAR).reshape(-1) for plane in chroma]
    return np.concatenate([luma.reshape(-1), *parts]).reshape(-1, luma.shape[1]).astype(np.uint8, copy=False)


def _stretched(side: int, by: float) -> int:
    return 2 * round(side * by / 2) if side % 2 == 0 else round(side * by)
