"""What is between the camera and the belt: streaks of rain, flakes of snow, drops on the lens."""

from __future__ import annotations

import math

import cv2
import numpy as np

from lumpwatch.service.simulator.noise import Field
from lumpwatch.service.simulator.spec import FeedSpec

_TILE = 256  # how far the tile of streaks reaches beyond the picture
_FLAKES = 320  # in the densest snow


class Rain:
    """Streaks that are elsewhere in each frame: drops fall farther than the picture is high."""

    def __init__(self, spec: FeedSpec) -> None:
        self._spec = spec
        rng = np.random.default_rng([spec.seed, 18])
        height, width = spec.height + _TILE, spec.width + _TILE
        tile = np.zeros((height, width), np.uint8)
        slant = rng.uniform(-0.25, 0.25)
        for _ in range(round(900 * spec.rain * width * height / (896 * 736))):
            x, y = rng.uniform(0, width), rng.uniform(0, height)
            long = spec.height * rng.uniform(0.04, 0.13)
            end = (round(x + slant * long), round(y + long))
            start = (round(x), round(y))
            cv2.line(tile, start, end, int(rng.integers(25, 95)), int(rng.integers(1, 3)), cv2.LINE_AA)
        self._tile = cv2.GaussianBlur(tile, (0, 0), 0.7).astype(np.float32)

    def apply(self, lit: Field, gain: float, frame: int) -> Field:
        """The picture with streaks that are as bright as the light."""
        x, y = np.random.default_rng([self._spec.seed, 19, frame]).integers(0, _TILE, 2)
        streaks = self._tile[y : y + lit.shape[0], x : x + lit.shape[1]]
        return np.asarray(cv2.scaleAdd(streaks, gain, lit), np.float32)


class Snow:
    """Flakes that fall and sway; near ones are large, fast and blurred."""

    def __init__(self, spec: FeedSpec) -> None:
        rng = np.random.default_rng([spec.seed, 20])
        n = round(_FLAKES * spec.snow)
        self._size = (spec.height, spec.width)
        self._start = rng.uniform(0, 1, (n, 2)) * (spec.width, spec.height)
        near = rng.uniform(0, 1, n) ** 2
        self._radius = (0.0022 + 0.007 * near) * spec.height
        self._speed = (0.25 + 0.8 * near) * spec.height
        self._sway = rng.uniform(0, 2 * math.pi, n)
        self._drift = rng.uniform(0.05, 0.15) * spec.width

    def apply(self, lit: Field, gain: float, t: float) -> Field:
        """The picture with the flakes of time t."""
        height, width = self._size
        margin = 0.02 * height
        x = self._start[:, 0] + self._drift * t + 0.02 * height * np.sin(2.1 * t + self._sway)
        y = self._start[:, 1] + self._speed * t
        x, y = x % (width + 2 * margin) - margin, y % (height + 2 * margin) - margin
        veil = np.zeros(lit.shape, np.uint8)
        for u, v, radius in zip(x * 8, y * 8, self._radius * 8, strict=True):
            cv2.circle(veil, (round(u), round(v)), max(round(radius), 4), 200, -1, cv2.LINE_AA, 3)
        cover = cv2.GaussianBlur(veil, (0, 0), 0.9).astype(np.float32) / 255
        return lit + cover * (np.float32(215 * gain) - lit)


class Drops:
    """Drops on the lens: what is behind one is blurred, upside down and brighter at the lower edge.

    Each stays for 10 to 25 s, then another sits elsewhere.
    """

    def __init__(self, spec: FeedSpec) -> None:
        self._spec = spec
        rng = np.random.default_rng([spec.seed, 21])
        self._lives = [
            (float(rng.uniform(10, 25)), float(rng.uniform(0, 25))) for _ in range(spec.lens_drops)
        ]

    def apply(self, lit: Field, t: float) -> Field:
        """The picture through the wet lens."""
        height, width = lit.shape
        through = lit.copy()
        for i, (life, phase) in enumerate(self._lives):
            rng = np.random.default_rng([self._spec.seed, 22, i, int((t + phase) / life)])
            radius = max(round(height * rng.uniform(0.015, 0.06)), 3)
            u, v = int(rng.integers(radius, width - radius)), int(rng.integers(radius, height - radius))
            window = (slice(v - radius, v + radius), slice(u - radius, u + radius))
            behind = cv2.GaussianBlur(cv2.flip(lit[window], -1), (0, 0), radius / 3)
            y, x = np.mgrid[-radius:radius, -radius:radius] + np.float32(0.5)
            cover = np.clip((radius - np.hypot(x, y)) / (0.25 * radius), 0, 1).astype(np.float32)
            behind *= (0.95 + 0.3 * y / radius).astype(np.float32)
            through[window] += cover * (behind - through[window])
        return through
