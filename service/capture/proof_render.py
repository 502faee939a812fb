"""A lump put into a picture: a labelled one of the site, or a shaded body with its shadow and the picture's grain."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.service.core import LARGEST_PX, MARGIN
from lumpwatch.service.protocol import CutPicture
from lumpwatch.service.simulator import View, body, draw_body, pyramid, turned

_TEXELS = 160.0
_VIEW = View(0.75, np.array([-0.42, -0.30, 0.856]) / np.linalg.norm([-0.42, -0.30, 0.856]))
_CONTRAST, _SPREAD = 0.9, 0.55
"""Mean and spread of the lump's brightness above that of its surroundings, in standard deviations of those."""
_BLOCK = 16
_FADES = 0.85
"""From here on to its border a cut fades; the corners of the labelled box lie just within."""

Field = NDArray[np.float32]


class Sprite:
    """The picture of one lump."""

    def __init__(
        self,
        picture: Field,
        box: tuple[float, float],
        *,
        gain: float | None = None,
        offset: float = 0.0,
        grain: bool = True,
    ) -> None:
        """`picture` (k, k, 3) is brightness times body, body and shadow, `box` width and height of the body in it.

        `gain` and `offset` are in standard deviations of the surroundings, from their mean; None: the brightness is
        in grey levels. `grain` says whether the picture's own is put on it.
        """
        self._levels = pyramid(picture)
        self._box = box
        self._gain, self._offset = gain, offset
        self.has_grain = grain

    def greys(self, value: Field, mask: Field, around: tuple[float, float]) -> Field:
        """Grey levels times body, in surroundings of that mean and spread."""
        if self._gain is None:
            return value
        mean, spread = around
        return np.asarray(mask * (mean + self._offset * spread) + self._gain * spread * value, np.float32)

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


def drawn_lump(rng: np.random.Generator, greys: tuple[float, ...] | None) -> Sprite:
    """A shaded body; `greys` are quantiles of its brightness, None: to be taken from the surroundings."""
    shape = draw_body(body(rng), turned(float(rng.uniform(0.0, 2 * np.pi))), _VIEW, _TEXELS)
    grey, mask, shadow = np.moveaxis(shape.levels[0], 2, 0)
    inside = mask > 0.5
    values = grey / np.maximum(mask, 1e-3)
    if greys is None:
        drawn = (values - values[inside].mean()) / values[inside].std()
    else:
        ranks = np.searchsorted(np.sort(values[inside]), values) / np.count_nonzero(inside)
        drawn = np.interp(ranks, np.linspace(0.0, 1.0, len(greys)), greys)
    return Sprite(
        np.dstack((drawn * mask, mask, shadow)).astype(np.float32),
        (2 * shape.half_width * _TEXELS, 2 * shape.half_height * _TEXELS),
        gain=_SPREAD if greys is None else None,
        offset=_CONTRAST,
    )


def labelled_lump(cut: CutPicture) -> Sprite:
    """A lump as it looked, as much brighter or darker than its surroundings as it was then.

    What lay close around it comes along, so that its outline does, and fades into the picture.
    """
    luma = np.frombuffer(cut.pixels, np.uint8).reshape(cut.height, cut.width).astype(np.float32)
    side = LARGEST_PX
    value = (cv2.resize(luma, (side, side), interpolation=cv2.INTER_LINEAR) - cut.mean) / cut.spread
    across = np.abs((np.arange(side) + 0.5) / side * 2.0 - 1.0)
    out = (across[:, None] ** 4 + across[None, :] ** 4) ** 0.25
    mask = np.clip((1.0 - out) / (1.0 - _FADES), 0.0, 1.0)
    of_box = side / (1.0 + 2.0 * MARGIN)
    picture = np.dstack((value * mask, mask, np.zeros_like(mask))).astype(np.float32)
    return Sprite(picture, (of_box, of_box), gain=1.0, grain=False)


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
    grey = sprite.greys(value, mask, around)
    if sprite.has_grain:
        grey = grey + mask * noise * rng.standard_normal(mask.shape, dtype=np.float32)
    keep = (1.0 - mask) * (1.0 - shadow)
    window = plane[y0:y1, x0:x1]
    if plane.ndim == 3:
        grey, keep = grey[..., None], keep[..., None]
    window[...] = np.clip(np.rint(window * keep + grey), 0, 255).astype(np.uint8)
