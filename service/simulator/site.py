"""Two looks of a feed: where its light comes from, its bed of ore, and what does not move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.backdrop import backdrop, illumination
from lumpwatch.service.simulator.bodies import View
from lumpwatch.service.simulator.cobbles import cobbles
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.noise import Field
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.sprites import rubble
from lumpwatch.service.simulator.yard import daylight, yard

# Blue, green and red of a grey level; the luma stays: brown ore under lamps, a cool morning.
_TINTS = {"a": (0.86, 0.99, 1.075), "b": (1.09, 1.005, 0.955)}
_LAMPS = (-0.45, 0.24, 0.86)  # world axes; in the picture from the upper left, in front


class Site:
    """The look that `spec.style` names."""

    def __init__(self, spec: FeedSpec, geometry: Geometry) -> None:
        self._spec, self._geometry = spec, geometry
        self.view = View(geometry.elevation, _light(spec))

    def still(self) -> NDArray[np.uint8]:
        """(h, w) picture of everything but the ore."""
        spec = self._spec
        draw = backdrop if spec.style == "a" else yard
        return draw(self._geometry, np.random.default_rng([spec.seed, 6]), spec.width, spec.height)

    def bed(self, width: int, length: int, texel_mm: float) -> Field:
        """(length, width) grey levels of the ore from above."""
        rng = np.random.default_rng([self._spec.seed, 7])
        if self._spec.style == "a":
            return rubble(rng, width, length, texel_mm)
        return cobbles(rng, width, length, texel_mm, self.view.light)

    def light(self) -> Field:
        """(h, w) factor on the light."""
        spec = self._spec
        field = (illumination if spec.style == "a" else daylight)(self._geometry, spec.width, spec.height)
        return _by_night(field, spec.night) if spec.night > 0 else field

    def tint(self) -> NDArray[np.uint8]:
        """(1, 256, 3): blue, green and red of each grey level. Infra-red pictures have no colour."""
        levels = np.arange(256)
        shares = (1 + (share - 1) * (1 - self._spec.night) for share in _TINTS[self._spec.style])
        tint = np.stack([levels * share for share in shares], -1)
        return np.asarray(np.clip(np.round(tint), 0, 255).astype(np.uint8)[None])


def _light(spec: FeedSpec) -> NDArray[np.float64]:
    if spec.style == "a":
        towards = np.array(_LAMPS)
    else:
        rng = np.random.default_rng([spec.seed, 13])
        azimuth, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.75, 1.1)
        towards = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(height)])
    return np.asarray(towards / np.linalg.norm(towards), float)


def _by_night(light: Field, night: float) -> Field:
    """The light of an infra-red lamp beside the camera: a hot spot, dark corners."""
    height, width = light.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    distance = np.hypot(x - 0.52 * width, y - 0.48 * height) / height
    lamp = 0.10 + 0.75 * np.exp(-((distance / 0.42) ** 2)) + 0.9 * np.exp(-((distance / 0.13) ** 2))
    return np.asarray((1 - night) * light + night * lamp * light, np.float32)
