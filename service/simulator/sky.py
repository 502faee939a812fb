"""Light from above that moves: patches of sun, and shadows that sweep across the belt."""

from __future__ import annotations

import math

import cv2
import numpy as np

from lumpwatch.service.simulator.events import Moments
from lumpwatch.service.simulator.noise import Field, smooth_noise
from lumpwatch.service.simulator.spec import FeedSpec

_SIDE = 128  # texels of the patches' field, which repeats
_COARSE = 4  # computed on every fourth pixel
_PASSES_S = 4.0


class Sky:
    """Factor on the light of each pixel."""

    def __init__(self, spec: FeedSpec) -> None:
        self._spec = spec
        self._size = (spec.width, spec.height)
        self._small = (spec.width // _COARSE, spec.height // _COARSE)
        rng = np.random.default_rng([spec.seed, 16])
        self._patches = np.clip(1.4 * smooth_noise(rng, (_SIDE, _SIDE), 26) - 0.7, 0, 1)
        self._shadows = Moments((spec.seed, 17), spec.shadow_every_s)
        y, x = np.mgrid[: self._small[1], : self._small[0]].astype(np.float32)
        # -1..1 across the picture.
        self._x, self._y = 2 * x / self._small[0] - 1, 2 * y / self._small[1] - 1

    def light(self, t: float) -> Field:
        """(h, w) factor at time t."""
        spec = self._spec
        factor = np.ones(self._small[::-1], np.float32)
        if spec.sun_patches > 0:
            zoom = 0.9 * 128 / self._small[1]
            matrix = np.array([[zoom, 0, 2.2 * t % _SIDE], [0, zoom, 0.9 * t % _SIDE]])
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            lit = cv2.warpAffine(self._patches, matrix, self._small, flags=flags, borderMode=cv2.BORDER_WRAP)
            factor += spec.sun_patches * lit
        if spec.shadow_edges > 0:
            for s, mark in self._shadows.since(t, _PASSES_S):
                factor *= 1 - spec.shadow_edges * self._band(s / _PASSES_S, mark)
        return np.asarray(cv2.resize(factor, self._size, interpolation=cv2.INTER_LINEAR), np.float32)

    def _band(self, progress: float, mark: float) -> Field:
        """A stripe half a picture wide with edges of a few pixels, on its way in the direction of `mark`."""
        angle = 2 * math.pi * mark
        along = math.cos(angle) * self._x + math.sin(angle) * self._y
        reach = abs(math.cos(angle)) + abs(math.sin(angle))
        middle = (2 * progress - 1) * (reach + 0.55)
        return np.asarray(np.clip((0.5 - np.abs(along - middle)) / 0.05 + 0.5, 0, 1), np.float32)
