"""What disturbs the picture: light, dust, water, vibration, exposure and noise. All functions of time."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.events import Moments
from lumpwatch.service.simulator.lens import Drops, Rain, Snow
from lumpwatch.service.simulator.noise import Field, smooth_noise
from lumpwatch.service.simulator.sky import Sky
from lumpwatch.service.simulator.spec import FeedSpec

_SIDE = 192  # texels of the clouds' field, which repeats
_COARSE = 8  # dust is computed on every eighth pixel
_NIGHT_NOISE = 16.0
_BURST_S = (0.5, 5.0)  # a burst of dust rises and settles


class Weather:
    """Disturbances of a feed with the light field `light`, (h, w)."""

    def __init__(self, spec: FeedSpec, light: Field, source_row: float) -> None:
        self._spec, self._light = spec, light
        rng = np.random.default_rng([spec.seed, 4])
        self._phases = rng.uniform(0, 2 * math.pi, 12)
        height, width = spec.height, spec.width
        octaves = ((48, 1.0), (20, 0.6), (8, 0.35), (4, 0.15))
        cloud = sum(share * smooth_noise(rng, (_SIDE, _SIDE), grain) for grain, share in octaves)
        self._cloud = np.asarray(cloud, np.float32)
        self._small = (max(width // _COARSE, 8), max(height // _COARSE, 8))
        rows = np.linspace(0, 1, self._small[1], dtype=np.float32)[:, None]
        # Ore that falls raises dust: the clouds are thickest over the lip.
        self._source = 0.55 + 0.75 * np.exp(-(((rows - source_row / height) / 0.22) ** 2))
        tile = (height + 64, width + 64)
        noise = rng.standard_normal(tile, dtype=np.float32) * spec.noise
        if spec.night > 0:
            grain = smooth_noise(np.random.default_rng([spec.seed, 23]), tile, 1.6)
            noise += _NIGHT_NOISE * spec.night * grain
        self._noise = np.round(noise).astype(np.int16)
        self._noisy = spec.noise > 0 or spec.night > 0
        self._bursts = Moments((spec.seed, 24), spec.dust_burst_every_s)
        self._jumps = Moments((spec.seed, 25), spec.exposure_every_s)
        self._sky = Sky(spec) if spec.sun_patches > 0 or spec.shadow_edges > 0 else None
        self._rain = Rain(spec) if spec.rain > 0 else None
        self._snow = Snow(spec) if spec.snow > 0 else None
        self._drops = Drops(spec) if spec.lens_drops > 0 else None

    def shift(self, t: float) -> tuple[float, float]:
        """How far vibration and a knock move the picture, pixels."""
        dx, dy = self._vibration(t)
        knocked = self._spec.camera_shift_at_s
        if knocked is None or t < knocked:
            return dx, dy
        return dx + self._spec.camera_shift_x_px, dy + self._spec.camera_shift_y_px

    def _vibration(self, t: float) -> tuple[float, float]:
        if self._spec.shake_px == 0:
            return 0.0, 0.0
        p, waves = self._phases, (6.1, 9.7, 14.3)
        dx, dy = (
            sum(math.sin(2 * math.pi * f * t + p[start + i]) for i, f in enumerate(waves)) / len(waves)
            for start in (0, 3)
        )
        return 0.8 * self._spec.shake_px * dx, 1.2 * self._spec.shake_px * dy

    def light(self, t: float) -> float:
        """Factor on the light."""
        spec, p = self._spec, self._phases
        drift = 0.6 * math.sin(2 * math.pi * t / 61 + p[6]) + 0.4 * math.sin(2 * math.pi * t / 23 + p[7])
        lamp = 0.6 * math.sin(2 * math.pi * 3.7 * t + p[8]) + 0.4 * math.sin(2 * math.pi * 5.3 * t + p[9])
        step = spec.light_step if spec.light_step_at_s is not None and t >= spec.light_step_at_s else 1.0
        return (1 + spec.light_drift * drift) * (1 + spec.flicker * lamp) * step * self._exposure(t)

    def _exposure(self, t: float) -> float:
        spec = self._spec
        if spec.exposure_jump == 1:
            return 1.0
        tau = spec.exposure_recovery_s
        steps = (math.copysign(math.exp(-s / tau), u - 0.5) for s, u in self._jumps.since(t, 6 * tau))
        level = min(max(sum(steps), -1.5), 1.5)
        return float(spec.exposure_jump**level)

    def _dust(self, t: float) -> float:
        spec = self._spec
        if spec.dust_burst == 0:
            return spec.dust
        rise, settle = _BURST_S
        bursts = (
            min(s / rise, math.exp(-max(s - rise, 0) / (0.4 * settle)), 1) * (0.4 + 0.6 * u)
            for s, u in self._bursts.since(t, 2.5 * settle)
        )
        return spec.dust + spec.dust_burst * max(bursts, default=0.0)

    def apply(self, picture: NDArray[np.uint8], t: float, frame: int) -> NDArray[np.uint8]:
        """The picture as the camera records it."""
        gain = self.light(t)
        lit = np.asarray(cv2.multiply(picture, self._light, scale=gain, dtype=cv2.CV_32F), np.float32)
        if self._sky is not None:
            lit *= self._sky.light(t)
        # By night all that scatters light scatters the little there is.
        gain *= 1 - 0.7 * self._spec.night
        if (dust := self._dust(t)) > 0:
            # Dust takes away and scatters light: lit + veil * (bright - lit).
            lit = _veiled(lit, self._veil(t, dust), 150 * gain)
        if self._spec.steam > 0:
            lit = _veiled(lit, self._veil(6 * t + 500, 0.7 * self._spec.steam), 225 * gain)
        if self._snow is not None:
            lit = self._snow.apply(lit, gain, t)
        if self._rain is not None:
            lit = self._rain.apply(lit, gain, frame)
        if self._drops is not None:
            lit = self._drops.apply(lit, t)
        if not self._noisy:
            return np.asarray(cv2.convertScaleAbs(lit), np.uint8)
        x, y = np.random.default_rng([self._spec.seed, 5, frame]).integers(0, 64, 2)
        noise = self._noise[y : y + picture.shape[0], x : x + picture.shape[1]]
        return np.asarray(cv2.add(lit, noise, dtype=cv2.CV_8U), np.uint8)

    def _veil(self, t: float, strength: float) -> Field:
        """(h, w) share of dust in what the camera sees, 0..1."""
        columns, rows = self._small
        total = np.zeros((rows, columns), np.float32)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        # Two layers that drift apart and swell make clouds that change their form.
        for zoom, vx, vy in ((1.0, 5.0, -3.0), (1.6, -3.5, -5.5)):
            matrix = np.array([[zoom, 0, vx * t % _SIDE], [0, zoom, vy * t % _SIDE]])
            total += cv2.warpAffine(
                self._cloud, matrix, (columns, rows), flags=flags, borderMode=cv2.BORDER_WRAP
            )
        depth = 2 * strength * self._source * np.clip(0.5 + 0.3 * total, 0, None)
        veil = np.asarray(1 - np.exp(-depth), np.float32)
        return np.asarray(
            cv2.resize(veil, (self._light.shape[1], self._light.shape[0]), interpolation=cv2.INTER_LINEAR)
        )


def _veiled(lit: Field, veil: Field, bright: float) -> Field:
    dust = cv2.multiply(cv2.subtract(np.full_like(lit, bright), lit), veil)
    return np.asarray(cv2.add(lit, dust), np.float32)
