"""Bouncing square (paper 1, section 4.1): it crosses the picture in ten frames and bounces at the borders.

160 x 120 pixels, ten pictures a second; 30 empty pictures, 100 with the square, 30 empty ones. The square is textured
in black and white; every pixel has Gaussian noise and is clipped to 0 to 255. The same seed gives the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

WIDTH, HEIGHT, FPS = 160, 120, 10.0
SIDE, CROSSING, SHOWN, EMPTY = 20, 10, 100, 30
CONTRAST, NOISE = 70.0, 80.0
"""Grey levels: of the texture around the ground, and of the noise."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A clip and its truth."""

    pictures: tuple[Image, ...]
    """(h, w)."""
    centres: NDArray[np.float64]
    """Of the square in its pictures (n, 2), which begin after `EMPTY`."""
    bounced: NDArray[np.bool_]
    """Whether it bounced on its way to each picture (n,)."""

    @property
    def labels(self) -> str:
        """MOTChallenge text with the motion model of each step."""
        lines = []
        for k, ((x, y), bounced) in enumerate(zip(self.centres, self.bounced, strict=True)):
            model = "bounce_x" if bounced else "constant_velocity"
            corner = f"{x - SIDE / 2:.2f},{y - SIDE / 2:.2f}"
            lines.append(f"{EMPTY + k + 1},1,{corner},{SIDE},{SIDE},1,1,1,{model}\n")
        return "".join(lines)


def make_scene(seed: int, noise: float = NOISE, contrast: float = CONTRAST, shown: int = SHOWN) -> Scene:
    """One clip; with `shown` 0 the square never comes."""
    rng = np.random.default_rng([seed, 1])
    centres, bounced = _path(rng, shown)
    ground = np.asarray(cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 2.0), np.float64)
    ground = 120.0 + 10.0 * ground / ground.std()
    tiles = np.kron(np.indices((4, 4)).sum(axis=0) % 2 * 2.0 - 1.0, np.ones((SIDE // 4, SIDE // 4)))
    square = (120.0 + contrast * tiles).astype(np.float32)
    pictures = []
    for k in range(-EMPTY, shown + EMPTY):
        picture = ground.copy()
        if 0 <= k < shown:
            x, y = centres[k]
            placed = np.array([[1.0, 0.0, x - SIDE / 2], [0.0, 1.0, y - SIDE / 2]])
            there = np.asarray(cv2.warpAffine(np.ones_like(square), placed, (WIDTH, HEIGHT)))
            picture = picture * (1.0 - there) + cv2.warpAffine(square, placed, (WIDTH, HEIGHT))
        noisy = picture + noise * rng.standard_normal(picture.shape)
        pictures.append(np.clip(np.round(noisy), 0, 255).astype(np.uint8))
    return Scene(tuple(pictures), centres, bounced)


def _path(rng: np.random.Generator, shown: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    low, high, speed = SIDE / 2, WIDTH - SIDE / 2, (WIDTH - SIDE) / CROSSING
    x, y, way = rng.uniform(low, high), rng.uniform(0.3, 0.7) * HEIGHT, rng.choice([-1.0, 1.0])
    centres, bounced = [], []
    for k in range(shown):
        turns = k > 0 and not low <= x + way * speed <= high
        if turns:
            way = -way
        if k > 0:
            x = float(np.clip(x + way * speed + rng.standard_normal(), low, high))
            y = float(np.clip(y + 0.7 * rng.standard_normal(), low, HEIGHT - low))
        centres.append((x, y))
        bounced.append(turns)
    return np.array(centres).reshape(-1, 2), np.array(bounced, dtype=np.bool_)
