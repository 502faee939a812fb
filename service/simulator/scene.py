"""Draws the moving part of a feed: the bed of ore, its fall over the lip, and the rocks."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.gaps import Gaps
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.mouth import Mouth
from lumpwatch.service.simulator.noise import Field, smooth_noise
from lumpwatch.service.simulator.site import Site
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.traffic import Rock

_TEXELS = 480  # across the belt
Bands = list[tuple[int, int, int, NDArray[np.uint8]]]
_PERIOD_MM = 11_000.0  # the bed of ore repeats after this


class Scene:
    """Everything of the picture but light, dust, shake and noise."""

    def __init__(self, spec: FeedSpec, geometry: Geometry, belt: BeltMotion, site: Site, gaps: Gaps) -> None:
        self._geometry, self._belt = geometry, belt
        self._size = (spec.width, spec.height)
        self._still = site.still()
        self._texel = spec.belt_width_mm / _TEXELS
        self._period = 4 * round(max(_PERIOD_MM, 1.2 * spec.belt_length_mm) / self._texel / 4)
        self.bed = site.bed(_TEXELS, self._period, self._texel)
        self._bed = self.bed.astype(np.uint8)
        self._bands = self._make_bands(self._bed)
        self._gaps = gaps
        self._rubber: Bands = []
        if gaps.any:
            self._rubber = self._make_bands(rubber(np.random.default_rng([spec.seed, 21]), self._bed.shape))
        self._prepare_fall(spec)
        self.mouth = Mouth(spec, geometry, belt, gaps, self.bed)

    def draw(self, t: float, rocks: Iterable[Rock]) -> NDArray[np.uint8]:
        """(h, w) picture at time t; rocks must come farthest first."""
        canvas = self._still.copy()
        distance = self._belt.distance(t)
        self._draw_bed(canvas, distance, self._bands)
        if self._gaps.any:
            self._draw_gaps(canvas, distance)
        self._draw_fall(canvas, t)
        for rock in rocks:
            self.draw_rock(canvas, rock)
        if self.mouth.any:
            self.mouth.draw(canvas, t)
        return canvas

    def _draw_gaps(self, canvas: NDArray[np.uint8], distance: float) -> None:
        """Show the belt itself where nothing lies on it."""
        lip = round(self._geometry.lip_row)
        middle = np.stack((np.full(lip, self._geometry.cu), np.arange(lip) + 0.5), -1)
        cover = self._gaps.cover(distance - self._geometry.to_mm(middle)[:, 1])
        rows = np.flatnonzero(cover < 1.0)
        if not len(rows):
            return
        bare = canvas.copy()
        self._draw_bed(bare, distance, self._rubber)
        share = cover[rows, None]
        canvas[rows] = np.round(share * canvas[rows] + (1.0 - share) * bare[rows]).astype(np.uint8)

    def _make_bands(self, texture: NDArray[np.uint8]) -> Bands:
        """Row bands of the belt with a bed reduced along the belt, so that far rows do not alias."""
        lip = round(self._geometry.lip_row)
        rows = np.arange(lip, dtype=float)
        middle = np.stack((np.full(lip + 1, self._geometry.cu), np.arange(lip + 1.0)), -1)
        texels_a_row = np.diff(self._geometry.to_mm(middle)[:, 1]) / self._texel
        bands: Bands = []
        for level, (low, high) in enumerate(((0.0, 2.6), (2.6, 4.6), (4.6, np.inf))):
            inside = rows[(texels_a_row >= low) & (texels_a_row < high)]
            if len(inside) == 0:
                continue
            factor = 1 << level
            size = (_TEXELS, self._period // factor)
            bed = np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.uint8)
            # One visible length more, so that no row needs to wrap.
            more = round(1.05 * self._geometry.belt_length_mm / self._texel / factor) + 8
            bands.append((int(inside[0]), int(inside[-1]) + 1, factor, np.vstack((bed, bed[:more]))))
        return bands

    def _draw_bed(self, canvas: NDArray[np.uint8], distance: float, bands: Bands) -> None:
        from_px = np.linalg.inv(self._geometry.homography)
        half = self._geometry.belt_width_mm / 2
        offset = -distance / self._texel % self._period
        for top, bottom, factor, bed in bands:
            along = self._texel * factor
            # Pixel centres lie at half-integers of texels and of pixels alike.
            to_texel = np.array(
                [
                    [1 / self._texel, 0, half / self._texel - 0.5],
                    [0, 1 / along, offset / factor - 0.5],
                    [0, 0, 1],
                ]
            )
            from_row = np.array([[1, 0, 0.5], [0, 1, top + 0.5], [0, 0, 1]])
            cv2.warpPerspective(
                bed,
                to_texel @ from_px @ from_row,
                (self._size[0], bottom - top),
                dst=canvas[top:bottom],
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_TRANSPARENT,
            )

    def _prepare_fall(self, spec: FeedSpec) -> None:
        """For each row between lip and rim: since when ore falls that is seen there, and where from."""
        geometry = self._geometry
        top, bottom = round(geometry.lip_row), geometry.rim_row
        since = np.linspace(0, 1.5, 3000)
        drop = [
            geometry.project(
                0, geometry.belt_length_mm + spec.belt_speed_mm_s * s, -spec.gravity_mm_s2 * s * s / 2
            )
            for s in since
        ]
        rows = np.arange(top, bottom) + 0.5
        _, v, scale = np.array(drop).T
        falling = v >= geometry.lip_row - 1
        self._since = np.interp(rows, v[falling], since[falling])
        x_mm = (np.arange(spec.width) + 0.5 - geometry.cu) / np.interp(rows, v[falling], scale[falling])[
            :, None
        ]
        self._fall_x = ((x_mm + spec.belt_width_mm / 2) / self._texel - 0.5).astype(np.float32)
        self._fall_rows = (top, bottom)
        self._fall_bed = np.vstack((self._bed, self._bed[:2]))
        # Ore spreads as it gains speed: only what was highest on the belt is still close together.
        self._thin = np.clip(self._since / max(self._since[-1], 1e-6), 0, 1)[:, None].astype(np.float32)

    def _draw_fall(self, canvas: NDArray[np.uint8], t: float) -> None:
        top, bottom = self._fall_rows
        lip = self._geometry.belt_length_mm
        came = np.array([self._belt.distance(t - s) for s in self._since])
        moving = np.array([self._belt.speed(t - s) for s in self._since]) / self._belt.full_speed_mm_s
        moving = np.minimum(moving, 1) * self._gaps.cover(came - lip)
        # Twice as dense as on the belt: the gain in speed alone would draw the stones out into streaks.
        y = (2 * (lip - came) / self._texel % self._period)[:, None].astype(np.float32)
        map_y = np.repeat(y, self._size[0], axis=1)
        ore = cv2.remap(self._fall_bed, self._fall_x, map_y, cv2.INTER_LINEAR).astype(np.float32)
        cover = np.clip((ore - 30 - 75 * self._thin) / 45, 0, 1) * moving[:, None].astype(np.float32)
        window = canvas[top:bottom]
        window[:] = window + cover * (ore - window)

    def draw_rock(self, canvas: NDArray[np.uint8], rock: Rock) -> None:
        """Draw one rock with its shadow over what is on the (h, w) canvas."""
        shape = rock.shape
        u, v, scale = self._geometry.project(rock.x, rock.y, rock.z)
        size = rock.size_mm * scale
        zoom = size / shape.texels
        level = 0
        while zoom * (1 << level) < 0.6 and level + 1 < len(shape.levels):
            level += 1
        sprite: Field = shape.levels[level]
        zoom *= shape.levels[0].shape[0] / sprite.shape[0]
        reach = zoom * sprite.shape[0] / 2
        x0, y0 = max(int(u - reach), 0), max(int(v - reach), 0)
        x1, y1 = min(int(u + reach) + 2, canvas.shape[1]), min(int(v + reach) + 2, self._geometry.rim_row)
        if x1 <= x0 or y1 <= y0:
            return
        # The sprite's middle lies on (u, v), both in coordinates whose pixel centres are half-integers.
        corner = zoom * (0.5 - sprite.shape[0] / 2) - 0.5
        matrix = np.array([[zoom, 0, u - x0 + corner], [0, zoom, v - y0 + corner]])
        warped = cv2.warpAffine(sprite, matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
        grey, body, shadow = np.moveaxis(warped, 2, 0)
        window = canvas[y0:y1, x0:x1]
        keep = 1 - body
        if rock.fallen_s == 0:
            keep *= 1 - shadow
        window[:] = np.clip(window * keep + rock.tone * grey, 0, 255)


def rubber(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """A belt from above (length, width): dark, smooth, with faint stains."""
    length, width = shape
    stains = smooth_noise(rng, (length, width), 40.0)
    return np.asarray(np.clip(np.round(46.0 + 2.0 * stains), 0, 255), np.uint8)
