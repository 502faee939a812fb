"""Fields of noise that ore and dust are made of; all periodic in both directions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Field = NDArray[np.float32]
_LIGHT = np.array([-0.45, -0.62, 0.64], np.float32)  # from the upper left, in front


def smooth_noise(rng: Generator, shape: tuple[int, int], grain: float) -> Field:
    """Gaussian noise with mean 0 and deviation 1 whose structures are about `grain` texels large."""
    rows, columns = shape
    # Drawn coarse and enlarged: a wide blur of the full field would cost far more.
    step = max(grain / 1.5, 1.0)
    small = (max(round(rows / step), 2), max(round(columns / step), 2))
    field = _wrapped_blur(rng.standard_normal(small, dtype=np.float32), 0.8)
    if small != shape:
        padded = cv2.copyMakeBorder(field, 2, 2, 2, 2, cv2.BORDER_WRAP)
        sx, sy = small[1] / columns, small[0] / rows
        matrix = np.array([[sx, 0, 2 + (sx - 1) / 2], [0, sy, 2 + (sy - 1) / 2]])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        field = np.asarray(cv2.warpAffine(padded, matrix, (columns, rows), flags=flags), np.float32)
    field -= field.mean()
    return np.asarray(field / max(float(field.std()), 1e-6), np.float32)


def stones(rng: Generator, shape: tuple[int, int], diameter: float, share: float) -> tuple[Field, Field]:
    """Heights (0..0.5, in diameters) and tones (about -1..1) of stones strewn over a field.

    Stones are cut domes over the cells of scattered seeds, tilted at random so that they show
    facets; only `share` of the cells holds one.
    """
    label, distance, dx, dy, n = cells(rng, shape, diameter)
    reach = rng.uniform(0.42, 0.7, n).astype(np.float32)
    reach[rng.random(n) > share] = 1e-3
    tilt = rng.normal(0, 0.28, (n, 2)).astype(np.float32)
    tone = rng.normal(0, 0.55, n).astype(np.float32)
    dome = np.sqrt(np.clip(1 - (distance / reach[label]) ** 2, 0, None)) * reach[label] * 0.7
    height = np.where(dome > 0, dome + tilt[label, 0] * dx + tilt[label, 1] * dy, 0)
    return np.clip(height, 0, None).astype(np.float32), tone[label]


def relief(rng: Generator, shape: tuple[int, int], diameter: float) -> Field:
    """Heights in texels of a surface broken into flat facets about `diameter` wide."""
    label, _, dx, dy, n = cells(rng, shape, diameter)
    tilt = rng.normal(0, 0.24, (n, 2)).astype(np.float32)
    level = (tilt[label, 0] * dx + tilt[label, 1] * dy) * diameter
    return _wrapped_blur(level.astype(np.float32), max(diameter / 14, 0.6))


def shade(height: Field, strength: float) -> Field:
    """Brightness (about 1 on flat ground) of a height field (in texels) in slanting light."""
    padded = cv2.copyMakeBorder(height, 2, 2, 2, 2, cv2.BORDER_WRAP)
    gx = cv2.Sobel(padded, cv2.CV_32F, 1, 0, ksize=3)[2:-2, 2:-2] * (strength / 8)
    gy = cv2.Sobel(padded, cv2.CV_32F, 0, 1, ksize=3)[2:-2, 2:-2] * (strength / 8)
    lit = (-gx * _LIGHT[0] - gy * _LIGHT[1] + _LIGHT[2]) / np.sqrt(1 + gx * gx + gy * gy)
    hollow = height - _wrapped_blur(height, 5.0)
    return np.asarray(
        (0.28 + 1.12 * np.clip(lit, 0, None)) * np.clip(1 + 0.05 * hollow, 0.55, 1.2), np.float32
    )


def cells(
    rng: Generator, shape: tuple[int, int], diameter: float
) -> tuple[NDArray[np.int32], Field, Field, Field, int]:
    """Cells of scattered seeds: number, distance and offset (in diameters) to the seed, number of cells."""
    rows, columns = shape
    pad = int(2 * diameter) + 2
    n = max(int(rows * columns / (0.7 * diameter * diameter)), 4)
    seeds = np.stack((rng.integers(0, rows, n), rng.integers(0, columns, n)), -1)
    shifts = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]) * (rows, columns)
    copies = (seeds[None] + shifts[:, None]).reshape(-1, 2) + pad
    owner = np.tile(np.arange(n, dtype=np.int32), 9)
    tall, wide = rows + 2 * pad, columns + 2 * pad
    near = (copies >= 0).all(1) & (copies < (tall, wide)).all(1)
    copies, owner = copies[near], owner[near]
    mask = np.ones((tall, wide), np.uint8)
    mask[copies[:, 0], copies[:, 1]] = 0
    _, label = cv2.distanceTransformWithLabels(mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    at = label[copies[:, 0], copies[:, 1]]
    source = np.zeros(int(label.max()) + 1, np.int32)
    source[at] = np.arange(len(copies), dtype=np.int32)
    found = source[label[pad : pad + rows, pad : pad + columns]]
    y, x = np.indices((rows, columns), dtype=np.float32)
    dy = (y + pad - copies[:, 0].astype(np.float32)[found]) / np.float32(diameter)
    dx = (x + pad - copies[:, 1].astype(np.float32)[found]) / np.float32(diameter)
    return owner[found], np.sqrt(dx * dx + dy * dy), dx, dy, n


def _wrapped_blur(field: Field, sigma: float) -> Field:
    pad = int(3 * sigma) + 1
    padded = cv2.copyMakeBorder(field, pad, pad, pad, pad, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(padded, (0, 0), sigma)[pad:-pad, pad:-pad], np.float32)
