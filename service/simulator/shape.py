"""A rock as the camera sees it: pictures of it in several sizes, and its silhouette row by row."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.noise import Field

_RESOLUTION = 512
_ROWS = 64


@dataclass(frozen=True)
class Shape:
    """One rock. Lengths are in units of its longest diameter; the origin is the middle of its box.

    `levels` holds (k, k, 3) pictures (grey times body, body, shadow), each half the size of the one
    before; `texels` is the longest diameter in the first of them.
    """

    levels: tuple[Field, ...]
    texels: float
    half_width: float
    half_height: float
    rows: NDArray[np.float64]
    """Edges of the n rows of the silhouette, n + 1, from -half_height to half_height."""
    area: NDArray[np.float64]
    """Share of the silhouette above each edge of `rows`."""
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    shown: float = 1.0
    """Share of the whole silhouette that is not buried."""

    @classmethod
    def of_outline(cls, outline: NDArray[np.float64], sprite: Field, texels: float) -> Shape:
        """A shape of its (n, 2) outline around the origin and its largest picture, the origin in its middle."""
        half_width, half_height = outline.max(0)
        mask = filled((outline + 0.5) * _RESOLUTION, _RESOLUTION) > 0.5
        profile = _profile(mask, float(half_height))
        return cls(pyramid(sprite), float(texels), float(half_width), float(half_height), *profile)

    @classmethod
    def of_sprite(cls, sprite: Field, texels: float, whole: Shape) -> Shape:
        """The shape that shows in a picture in which parts of the shape `whole` were hidden."""
        mask = sprite[..., 1] > 0.5
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        half_height, half_width = (
            (rows[-1] + 1 - rows[0]) / 2 / texels,
            (columns[-1] + 1 - columns[0]) / 2 / texels,
        )
        side = sprite.shape[0]
        centre = np.array([columns[0] + columns[-1] + 1, rows[0] + rows[-1] + 1]) / 2
        move = np.hstack((np.eye(2), (side / 2 - centre)[:, None]))
        sprite = np.asarray(cv2.warpAffine(sprite, move, (side, side)), np.float32)
        zoom = _RESOLUTION / texels
        corner = zoom * (0.5 - side / 2) + _RESOLUTION / 2 - 0.5
        matrix = np.array([[zoom, 0, corner], [0, zoom, corner]])
        large = cv2.warpAffine(sprite[..., 1].copy(), matrix, (_RESOLUTION, _RESOLUTION))
        profile = _profile(np.asarray(large, np.float32) > 0.5, half_height)
        shown = float(mask.sum() / max(np.count_nonzero(whole.levels[0][..., 1] > 0.5), 1))
        return cls(pyramid(sprite), float(texels), half_width, half_height, *profile, shown=min(shown, 1.0))

    def share_between(self, top: float, bottom: float) -> float:
        """Share of the silhouette between two heights."""
        above = np.interp((top, bottom), self.rows, self.area)
        return float(max(above[1] - above[0], 0.0))

    def extent_between(self, top: float, bottom: float) -> tuple[float, float]:
        """Leftmost and rightmost x of the part of the silhouette between two heights."""
        n = len(self.left)
        first = int(np.clip(np.searchsorted(self.rows, top, "right") - 1, 0, n - 1))
        last = int(np.clip(np.searchsorted(self.rows, bottom, "left"), first + 1, n))
        return float(self.left[first:last].min()), float(self.right[first:last].max())


def filled(points: NDArray[np.float64], side: int) -> Field:
    """Coverage of a polygon, 0..1; pixel (i, j) covers i..i+1, j..j+1."""
    bits = 4
    fixed = np.round((points - 0.5) * (1 << bits)).astype(np.int32)
    canvas = np.zeros((side, side), np.uint8)
    cv2.fillPoly(canvas, [fixed], 255, cv2.LINE_AA, bits)
    return np.asarray(canvas / np.float32(255), np.float32)


def pyramid(sprite: Field) -> tuple[Field, ...]:
    """The sprite and its halves."""
    levels = [sprite]
    while levels[-1].shape[0] > 24:
        half = levels[-1].shape[0] // 2
        smaller = cv2.resize(levels[-1], (half, half), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(smaller, np.float32))
    return tuple(levels)


def _profile(
    mask: NDArray[np.bool_], half_height: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Row edges, area above them, left and right of a silhouette one diameter by one diameter large."""
    rows = np.linspace(-half_height, half_height, _ROWS + 1)
    edges = ((rows + 0.5) * _RESOLUTION).round().astype(int)
    above = np.concatenate(([0], np.cumsum(mask.sum(1))))
    there = np.asarray(mask.any(1), np.bool_)
    first = np.where(there, mask.argmax(1), _RESOLUTION)
    last = np.where(there, _RESOLUTION - mask[:, ::-1].argmax(1), 0)
    left, right = np.zeros(_ROWS), np.zeros(_ROWS)
    for i, (top, bottom) in enumerate(pairwise(edges)):
        part = slice(top, max(bottom, top + 1))
        if there[part].any():
            left[i] = first[part].min() / _RESOLUTION - 0.5
            right[i] = last[part].max() / _RESOLUTION - 0.5
    area = (above[edges] - above[edges[0]]).astype(float)
    return rows, area / area[-1], left, right
