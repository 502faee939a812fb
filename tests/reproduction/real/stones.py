"""Rocks cut out along their outlines, to be laid on a strip: turned, scaled, with a shadow where they touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.reproduction.real.ore import Image, Piece, Points, rounded

_AROUND = 4


@dataclass(frozen=True, slots=True)
class Stone:
    """A whole rock by itself."""

    pixels: Image
    """BGR, what lies around it included (h, w, 3)."""
    corners: Points
    """Its outline in `pixels`."""
    length: float
    """The longer side of its upright box."""


@dataclass(frozen=True, slots=True)
class Cutout:
    """A stone made ready to lay down."""

    pixels: NDArray[np.float32]
    alpha: NDArray[np.float32]
    """0 to 1 (h, w)."""
    corners: Points


def stones(sources: Sequence[Piece], least: float = 26.0) -> tuple[Stone, ...]:
    """All whole rocks whose longer side is `least` or more."""
    found = []
    for source in sources:
        height, width = source.ore.shape
        for rock in source.rocks:
            if not rock.whole or rock.agglomerate or rock.length < least:
                continue
            low = np.maximum(np.floor(rock.corners.min(axis=0)).astype(int) - _AROUND, 0)
            high = np.minimum(np.ceil(rock.corners.max(axis=0)).astype(int) + _AROUND + 1, (width, height))
            if np.ptp(rock.corners, axis=0).min() < 0.42 * rock.length:
                continue
            part = source.pixels[low[1] : high[1], low[0] : high[0]]
            found.append(Stone(part, rock.corners - low, rock.length))
    return tuple(found)


def cutout(
    stone: Stone, length: float, turn_rad: float, mirror: bool, gain: float = 1.0, inward: float = 1.0
) -> Cutout:
    """The stone with its longer upright side `length`, turned; `inward` pixels of its rim are left out."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    middle = stone.corners.mean(axis=0)
    linear = np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    turned = (stone.corners - middle) @ linear.T
    scale = length / float(np.ptp(turned, axis=0).max())
    turned *= scale
    shift = 3.0 - turned.min(axis=0)
    corners = turned + shift
    size = np.ceil(corners.max(axis=0) + 4).astype(int)
    matrix = np.column_stack([linear * scale, shift - linear @ middle * scale])
    source = stone.pixels
    if scale < 0.55:
        source = np.asarray(cv2.GaussianBlur(source, (0, 0), 0.45 / scale), np.uint8)
    pixels = cv2.warpAffine(
        source, matrix, tuple(map(int, size)), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    mask = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(mask, [rounded(corners * 16)], (255,), cv2.LINE_AA, 4)
    if inward > 0 and length > 20:
        mask = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3)), iterations=round(inward))
    alpha = cv2.GaussianBlur(mask, (0, 0), 0.8).astype(np.float32) / np.float32(255)
    return Cutout(pixels.astype(np.float32) * np.float32(gain), alpha, corners)


def lay(
    canvas: Image,
    cut: Cutout,
    at: tuple[int, int],
    shade: float,
    reach: float,
    towards: tuple[float, float] = (0.5, 0.8),
) -> None:
    """Lay a cut-out with its top left corner `at` (x, y).

    Around it the canvas gets darker by up to `shade`, over about `reach` pixels, `towards` a side.
    """
    pad = int(np.ceil(reach * 2.5)) + 1
    x, y = at[0] - pad, at[1] - pad
    alpha = np.pad(cut.alpha, pad)
    height, width = alpha.shape
    a, b = max(0, y), min(canvas.shape[0], y + height)
    c, d = max(0, x), min(canvas.shape[1], x + width)
    if a >= b or c >= d:
        return
    if shade > 0:
        moved = np.array([[1, 0, towards[0] * reach], [0, 1, towards[1] * reach]], float)
        cast = cv2.GaussianBlur(cv2.warpAffine(alpha, moved, (width, height)), (0, 0), max(reach * 0.6, 0.6))
        touch = cv2.GaussianBlur(alpha, (0, 0), max(reach * 0.35, 0.6))
        dark = 1 - np.float32(shade) * np.clip(0.75 * cast + 0.5 * touch, 0, 1)
    else:
        dark = np.ones_like(alpha)
    window = slice(a - y, b - y), slice(c - x, d - x)
    m = alpha[window][..., None]
    pixels = np.pad(cut.pixels, ((pad, pad), (pad, pad), (0, 0)))[window]
    under = canvas[a:b, c:d].astype(np.float32) * dark[window][..., None]
    canvas[a:b, c:d] = np.clip(under * (1 - m) + pixels * m, 0, 255).astype(np.uint8)
