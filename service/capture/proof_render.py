"""A synthetic lump drawn into a picture: a shaded, textured body with its shadow and the picture's own grain."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.service.simulator import View, body, draw_body, pyramid, turned

_TEXELS = 160.0
_VIEW = View(0.75, np.array([-0.42, -0.30, 0.856]) / np.linalg.norm([-0.42, -0.30, 0.856]))
_CONTRAST, _SPREAD = 0.9, 0.55
"""Mean and spread of the lump's brightness above that of its surroundings, in standard deviations of those."""
_LEAST_SPREAD = 8.0
_BLOCK = 16

Field = NDArray[np.float32]


class Sprite:
    """The picture of one lump."""

    def __init__(self, rng: np.random.Generator, greys: tuple[float, ...] | None) -> None:
        """`greys` are quantiles of its brightness; None: to be taken from the surroundings."""
        shape = draw_body(body(rng), turned(float(rng.uniform(0.0, 2 * np.pi))), _VIEW, _TEXELS)
        grey, mask, shadow = np.moveaxis(shape.levels[0], 2, 0)
        inside = mask > 0.5
        values = grey / np.maximum(mask, 1e-3)
        if greys is None:
            drawn = (values - values[inside].mean()) / values[inside].std()
        else:
            ranks = np.searchsorted(np.sort(values[inside]), values) / np.count_nonzero(inside)
            drawn = np.interp(ranks, np.linspace(0.0, 1.0, len(greys)), greys)
        self.absolute = greys is not None
        """Whether its brightness is given in grey levels, not in standard deviations around the mean."""
        self._levels = pyramid(np.dstack((drawn * mask, mask, shadow)).astype(np.float32))
        self._box = 2 * shape.half_width * _TEXELS, 2 * shape.half_height * _TEXELS

    def at(self, x: float, y: float, w: float, h: float) -> tuple[Field, tuple[int, int]]:
        """Brightness times body, body and shadow (k, l, 3) of a lump whose box has this centre and size, px.

        And the first column and row of that window in the picture, which may lie outside of it.
        """
        scale = max(w / self._box[0], h / self._box[1])
        level = int(np.clip(np.floor(-np.log2(max(scale, 1e-6))), 0, len(self._levels) - 1))
        picture = self._levels[level]
        sx, sy = (side / full * 2**level for side, full in zip((w, h), self._box, strict=True))
        side = picture.shape[0]
        columns, rows = int(np.ceil(side * sx)) + 2, int(np.ceil(side * sy)) + 2
        left, top = int(np.floor(x - columns / 2)), int(np.floor(y - rows / 2))
        move = np.array(
            [
                [sx, 0.0, x - left - 0.5 - sx * (side / 2 - 0.5)],
                [0.0, sy, y - top - 0.5 - sy * (side / 2 - 0.5)],
            ]
        )
        return np.asarray(cv2.warpAffine(picture, move, (columns, rows)), np.float32), (left, top)


def surroundings(luma: Image) -> tuple[float, float]:
    """Mean and standard deviation of a part of the picture."""
    return float(luma.mean()), max(float(luma.std()), _LEAST_SPREAD)


def grain(luma: Image) -> float:
    """Standard deviation of the picture's noise, from its smoothest blocks (after Immerkaer 1996)."""
    kernel = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
    edges = np.abs(cv2.filter2D(luma, cv2.CV_32F, kernel))
    rows, columns = (side // _BLOCK * _BLOCK for side in luma.shape)
    if not rows or not columns:
        return 0.0
    blocks = edges[:rows, :columns].reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK).mean((1, 3))
    return float(np.quantile(blocks, 0.1) * np.sqrt(np.pi / 2) / 6.0)


def blend(
    plane: Image,
    sprite: Sprite,
    box: tuple[float, float, float, float],
    around: tuple[float, float],
    noise: float,
    rng: np.random.Generator,
) -> None:
    """Draw the lump into a plane (h, w) or (h, w, 3), in place; `box` is its centre and size, px.

    `around` are mean and standard deviation of the surroundings, `noise` is the grain.
    """
    drawn, (left, top) = sprite.at(*box)
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + drawn.shape[1], plane.shape[1]), min(top + drawn.shape[0], plane.shape[0])
    if x1 <= x0 or y1 <= y0:
        return
    part = drawn[y0 - top : y1 - top, x0 - left : x1 - left]
    value, mask, shadow = part[..., 0], part[..., 1], part[..., 2]
    mean, spread = around
    grey = value if sprite.absolute else mask * (mean + _CONTRAST * spread) + _SPREAD * spread * value
    grey = grey + mask * noise * rng.standard_normal(mask.shape, dtype=np.float32)
    keep = (1.0 - mask) * (1.0 - shadow)
    window = plane[y0:y1, x0:x1]
    if plane.ndim == 3:
        grey, keep = grey[..., None], keep[..., None]
    window[...] = np.clip(np.rint(window * keep + grey), 0, 255).astype(np.uint8)
