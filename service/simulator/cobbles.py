"""The ore of style b: broken stones that fill the belt edge to edge, each with two flat facets.

The stones are the cells of scattered seeds (a Voronoi diagram), in three sizes, large ones lying on small
ones. A cell is a roof: of two planes tilted at random, the lower one counts. Light comes from anywhere.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lumpwatch.service.simulator.noise import Field, cells, smooth_noise


def cobbles(rng: Generator, width: int, length: int, texel_mm: float, light: NDArray[np.float64]) -> Field:
    """(length, width) grey levels of a bed of ore, periodic along its length; light in world axes."""
    grey = np.full((length, width), 40, np.float32)
    for diameter, share in ((70.0, 1.0), (130.0, 0.5), (210.0, 0.25)):
        stone, cover = _stones(rng, (length, width), diameter / texel_mm, share, light)
        grey += cover * (stone - grey)
    fine = smooth_noise(rng, (length, width), 1.0)
    damp = smooth_noise(rng, (length, width), 420 / texel_mm)
    grey *= 1 + 0.07 * fine + 0.09 * damp
    x = np.abs(np.linspace(-1, 1, width, dtype=np.float32))
    grey *= 1 - 0.35 * np.clip((x - 0.93) / 0.07, 0, 1)
    return np.asarray(np.clip(grey, 4, 250), np.float32)


def _stones(
    rng: Generator, shape: tuple[int, int], diameter: float, share: float, light: NDArray[np.float64]
) -> tuple[Field, Field]:
    """Grey levels and cover (0..1) of one size of stones."""
    label, _, dx, dy, n = cells(rng, shape, diameter)
    there = (rng.random(n) < share)[label]
    tilts = rng.normal(0, 0.42, (2, n, 2)).astype(np.float32)
    normals = np.dstack((-tilts, np.ones((2, n, 1), np.float32)))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    lit = np.clip(normals @ light.astype(np.float32), 0, None)
    first, second = (tilt[label, 0] * dx + tilt[label, 1] * dy for tilt in tilts)
    tone = rng.normal(1, 0.14, n).astype(np.float32)
    grey = 132 * tone[label] * (0.3 + 0.9 * np.where(first < second, lit[0][label], lit[1][label]))
    border = (label != np.roll(label, 1, 0)) | (label != np.roll(label, 1, 1))
    inside = np.asarray(cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 3), np.float32)
    crack = np.clip(inside / (0.09 * diameter), 0, 1)
    grey *= 0.35 + 0.65 * crack
    return grey.astype(np.float32), there * np.clip(inside / max(0.03 * diameter, 1), 0, 1)
