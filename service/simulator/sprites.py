"""Pictures of ore, made from noise: the rubble on the belt and single rocks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lumpwatch.service.simulator.noise import Field, relief, shade, smooth_noise, stones
from lumpwatch.service.simulator.shape import Shape, filled


def rubble(rng: Generator, width: int, length: int, texel_mm: float) -> Field:
    """(length, width) grey levels of a bed of small stones, periodic along its length."""
    fine = smooth_noise(rng, (length, width), 1.2)
    height = 6.0 * fine
    albedo = 0.06 * fine
    for diameter, share in ((55.0, 1.0), (100.0, 0.75), (170.0, 0.4), (250.0, 0.14)):
        dome, tone = stones(rng, (length, width), diameter / texel_mm, share)
        dome *= diameter
        over = np.clip((dome - height) / 6.0, 0, 1)
        height = np.maximum(height, dome)
        albedo += over * (tone - albedo)
    patches = smooth_noise(rng, (length, width), 260 / texel_mm)
    grey = shade(height / texel_mm, 0.75) * (0.95 + 0.24 * albedo + 0.10 * patches)
    # Ore lies thinner and in the shadow of the walls at both sides.
    x = np.abs(np.linspace(-1, 1, width, dtype=np.float32))
    grey *= 1 - 0.55 * np.clip((x - 0.90) / 0.10, 0, 1) ** 1.5
    return np.clip(106 * grey, 4, 250).astype(np.float32)


def rock(rng: Generator, texels: int) -> Shape:
    """An irregular rounded rock, lit from the upper left, with a dark rim and a contact shadow."""
    outline = _outline(rng)
    pad = int(0.22 * texels)
    side = texels + 2 * pad
    centre = side / 2
    points = outline * texels + centre
    body = filled(points, side)
    y = np.arange(side, dtype=np.float32)[:, None]
    inside = cv2.distanceTransform((body > 0.5).astype(np.uint8), cv2.DIST_L2, 5)
    radius = max(float(inside.max()), 1.0)
    dome = 0.8 * radius * np.sqrt(1 - (1 - np.clip(inside / (0.75 * radius), 0, 1)) ** 2)
    facets = relief(rng, (side, side), texels / 3.2)
    rough = smooth_noise(rng, (side, side), texels / 20) * 0.006 * texels
    height = cv2.GaussianBlur(dome.astype(np.float32), (0, 0), texels / 50) + facets + rough
    grey = shade(height, 0.9) * (1 + 0.05 * smooth_noise(rng, (side, side), texels / 10))
    grey *= 0.96 + 0.045 * smooth_noise(rng, (side, side), 1.0)
    grey *= 0.55 + 0.45 * np.clip(inside / (0.07 * texels), 0, 1)  # rim
    grey *= 1.08 - 0.35 * np.clip((y - centre) / texels + 0.1, 0, 1)
    grey = np.clip(122 * grey, 6, 250)
    shifted = np.array([[1, 0, 0.05 * texels], [0, 1, 0.06 * texels]])
    shadow = cv2.GaussianBlur(cv2.warpAffine(body, shifted, (side, side)), (0, 0), texels / 22)
    sprite = np.dstack((grey * body, body, 0.75 * shadow * (1 - body))).astype(np.float32)
    return Shape.of_outline(outline, sprite, texels)


def _outline(rng: Generator) -> NDArray[np.float64]:
    """A closed rounded polygon, longest diameter 1, its box centred on the origin."""
    n = int(rng.integers(7, 11))
    angle = (np.arange(n) + rng.uniform(-0.32, 0.32, n)) * 2 * np.pi / n
    reach = rng.uniform(0.82, 1.1, n)
    p = np.stack((np.cos(angle), np.sin(angle)), -1) * reach[:, None]
    p[:, 1] *= rng.uniform(0.66, 0.9)
    tilt = rng.uniform(-0.45, 0.45)
    p = p @ np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    for _ in range(3):  # Chaikin's corner cutting
        following = np.roll(p, -1, 0)
        p = np.stack((0.8 * p + 0.2 * following, 0.2 * p + 0.8 * following), 1).reshape(-1, 2)
    p /= np.sqrt(((p[:, None] - p[None]) ** 2).sum(-1).max())
    return np.asarray(p - (p.min(0) + p.max(0)) / 2, float)
