"""What rocks look like: the shapes that the traffic draws from, and lumps that roll."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.random import Generator

from lumpwatch.service.simulator.bodies import Body, Vector, View, body, draw_body, silhouette, turned
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.noise import Field, smooth_noise
from lumpwatch.service.simulator.shape import Shape, pyramid
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.sprites import rock

_SHAPES, _OF_A_KIND = 20, 8
_KINDS = ("frozen", "smooth", "slab")


@dataclass(frozen=True)
class Rolling:
    """A body that turns while it rides, about an axis across the belt."""

    solid: Body
    yaw: float
    view: View
    contrast: float
    ore: Field
    texels: int
    """Longest diameter in its largest picture."""

    def half_height(self, angle: float) -> float:
        """Of the silhouette's box at an angle (rad), in diameters."""
        return float(silhouette(self.solid, self._rotation(angle), self.view)[0][:, 1].max())

    def shape(self, angle: float, size_px: float) -> Shape:
        """As seen at an angle (rad), fine enough for a longest diameter of `size_px`."""
        texels = min(max(size_px, 16.0), float(self.texels))
        seen = draw_body(self.solid, self._rotation(angle), self.view, texels, self.ore)
        return _faded(seen, self.contrast, self.ore) if self.contrast < 1 else seen

    def _rotation(self, angle: float) -> Vector:
        return turned(self.yaw, angle)


class Stock:
    """The shapes of a feed; `bed` is its ore as it lies on the belt."""

    def __init__(self, spec: FeedSpec, geometry: Geometry, view: View, bed: Field) -> None:
        self._spec, self._view = spec, view
        texels = self._texels = min(max(round(0.36 * spec.height), 64), 320)
        # Ore as the camera sees it, at the scale of a lump's picture.
        across = round(spec.belt_width_mm * texels / (1.3 * spec.limit_mm))
        size = (across, round(across * geometry.foreshortening(spec.belt_length_mm / 2)))
        seen = cv2.resize(bed[: bed.shape[1]], size, interpolation=cv2.INTER_AREA)
        self._ore = np.tile(seen, (2 * texels // size[1] + 2, 2 * texels // size[0] + 2)).astype(np.float32)
        rng = np.random.default_rng([spec.seed, 8])
        if spec.style == "a":
            self.plain = tuple(rock(rng, texels) for _ in range(_SHAPES))
        else:
            self.plain = self._bodies(rng, "rock", _SHAPES)
        own = np.random.default_rng([spec.seed, 14])
        self._shares = (spec.frozen_share, spec.smooth_share, spec.slab_share)
        self._kinds = {
            kind: self._bodies(own, kind, _OF_A_KIND)
            for kind, share in zip(_KINDS, self._shares, strict=True)
            if share > 0
        }
        self._kinds["plain"] = self.plain
        if spec.lump_contrast < 1:
            self._kinds = {
                kind: tuple(_faded(shape, spec.lump_contrast, self._patch(own)) for shape in shapes)
                for kind, shapes in self._kinds.items()
            }
        self._buried = {
            kind: tuple(_buried(own, shape) for shape in shapes)
            for kind, shapes in self._kinds.items()
            if spec.buried_share > 0
        }

    def lump(self, rng: Generator, plain: int, buried: bool) -> Shape:
        """The shape of a lump; `plain` is the number of its shape where no kind is asked for."""
        shapes = self.shapes(self._kind(rng), buried=buried)
        return shapes[plain % len(shapes)]

    def shapes(self, kind: str, *, buried: bool = False) -> tuple[Shape, ...]:
        """All shapes of a kind ("plain" or a named one). Raises KeyError for one that the feed does not have."""
        return (self._buried if buried else self._kinds)[kind]

    def rolling(self, rng: Generator) -> Rolling:
        """A lump that can turn."""
        kind = self._kind(rng).replace("plain", "rock")
        yaw = float(rng.uniform(0, 2 * np.pi))
        solid, ore = body(rng, kind), self._patch(rng)
        return Rolling(solid, yaw, self._view, self._spec.lump_contrast, ore, self._texels)

    def _kind(self, rng: Generator) -> str:
        return (*_KINDS, "plain")[int(np.searchsorted(np.cumsum(self._shares), rng.random(), "right"))]

    def _bodies(self, rng: Generator, kind: str, count: int) -> tuple[Shape, ...]:
        return tuple(
            draw_body(
                body(rng, kind), turned(rng.uniform(0, 2 * np.pi)), self._view, self._texels, self._patch(rng)
            )
            for _ in range(count)
        )

    def _patch(self, rng: Generator) -> Field:
        """Ore from somewhere on the belt, at least as large as any rock's picture."""
        rows, columns = (np.array(self._ore.shape) - 2 * self._texels).tolist()
        y, x = int(rng.integers(rows)), int(rng.integers(columns))
        return self._ore[y : y + 2 * self._texels, x : x + 2 * self._texels]


def _faded(shape: Shape, contrast: float, ore: Field) -> Shape:
    """The shape with its brightness and texture nearer to those of the ore."""
    grey, mask, shadow = np.moveaxis(shape.levels[0], 2, 0)
    side = grey.shape[0]
    faded = contrast * grey + (1 - contrast) * ore[:side, :side] * mask
    return replace(shape, levels=pyramid(np.dstack((faded, mask, contrast * shadow)).astype(np.float32)))


def _buried(rng: Generator, shape: Shape) -> Shape:
    """The shape with ore up to a ragged line."""
    sprite = shape.levels[0]
    side, texels = sprite.shape[0], shape.texels
    y = (np.arange(side, dtype=np.float32)[:, None] + 0.5 - side / 2) / texels
    line = shape.half_height * (2 * rng.uniform(0.45, 0.75) - 1)
    ragged = 0.05 * smooth_noise(rng, (side, side), texels / 9)
    above = np.clip((line + ragged - y) * texels / 3 + 0.5, 0, 1)
    return Shape.of_sprite((sprite * above[..., None]).astype(np.float32), texels, shape)
