"""The simulated feed: pictures of a crusher's belt, and the truth about the lumps in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from service.feed.backdrop import illumination
from service.feed.geometry import Geometry
from service.feed.motion import BeltMotion
from service.feed.scene import Scene
from service.feed.spec import FeedSpec
from service.feed.sprites import rock
from service.feed.traffic import Rock, Traffic
from service.feed.weather import Weather

_SHAPES = 20
_SEEN, _SWALLOWED = 0.5, 0.4  # labels start and end at these shares of a lump


@dataclass(frozen=True, slots=True)
class Truth:
    """A lump in one picture.

    x, y, w, h is the box of its visible part in pixels of the whole picture, x and y the upper left
    edge. `visibility` is the share of the lump inside the picture and above the rim of the crusher.
    `seconds_to_lip` is the time until its front edge is at the lip if the belt does not stop; past
    the lip it is the negative time since then.
    """

    id: int
    x: float
    y: float
    w: float
    h: float
    size_mm: float
    on_belt: bool
    model: Literal["belt", "fall"]
    visibility: float
    seconds_to_lip: float


class FeedSimulator:
    """Renders a feed frame by frame; frame i shows the moment i / fps."""

    def __init__(self, spec: FeedSpec) -> None:
        self.spec = spec
        self.geometry = Geometry.of(spec)
        self._belt = BeltMotion(spec)
        self._scene = Scene(spec, self.geometry, self._belt)
        light = illumination(self.geometry, spec.width, spec.height)
        self._weather = Weather(spec, light, self.geometry.lip_row)
        rng = np.random.default_rng([spec.seed, 8])
        texels = min(max(round(0.36 * spec.height), 64), 320)
        shapes = tuple(rock(rng, texels) for _ in range(_SHAPES))
        self._traffic = Traffic(spec, self.geometry, self._belt, shapes)
        self._frame = 0
        levels = np.arange(256)
        # Blue, green and red of a grey level: a little brown, its luma unchanged.
        tint = np.stack([levels * share for share in (0.86, 0.99, 1.075)], -1)
        self._tint = np.clip(np.round(tint), 0, 255).astype(np.uint8)[None]

    @property
    def time_s(self) -> float:
        """The moment that the next `render` shows, seconds from the start."""
        return self._frame / self.spec.fps

    @property
    def homography(self) -> NDArray[np.float64]:
        """3x3 matrix from the belt, (x, y, 1) in mm, to pixels; without the vibration."""
        return self.geometry.homography

    @property
    def polygon(self) -> tuple[tuple[float, float], ...]:
        """Outline of the belt and of the fall, relative to the picture (0..1): a region of interest."""
        size = (self.spec.width, self.spec.height)
        return tuple((float(u), float(v)) for u, v in np.clip(self.geometry.outline() / size, 0, 1).round(4))

    def render(self) -> tuple[NDArray[np.uint8], tuple[Truth, ...]]:
        """The next picture, uint8 (h, w) or (h, w, 3) BGR, and its lumps, farthest first."""
        t = self.time_s
        rocks = self._traffic.at(t)
        dx, dy = self._weather.shift(t)
        picture = self._scene.draw(t, rocks)
        if dx or dy:
            matrix = np.array([[1, 0, dx], [0, 1, dy]])
            size = (self.spec.width, self.spec.height)
            picture = np.asarray(
                cv2.warpAffine(picture, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.uint8
            )
        picture = self._weather.apply(picture, t, self._frame)
        if not self.spec.gray:
            picture = np.asarray(cv2.LUT(cv2.merge((picture, picture, picture)), self._tint), np.uint8)
        truths = tuple(truth for r in rocks if r.id and (truth := self._truth(r, dx, dy)) is not None)
        self._frame += 1
        return picture, truths

    def skip(self, frames: int = 1) -> None:
        """Pass over pictures without drawing them; what follows is what would have followed."""
        self._frame += frames

    def _truth(self, rock: Rock, dx: float, dy: float) -> Truth | None:
        u, v, scale = self.geometry.project(rock.x, rock.y, rock.z)
        size, shape = rock.size_mm * scale, rock.shape
        # In units of the lump's diameter, from the middle of its box. The picture's upper border
        # cuts after the vibration, the rim before it: the rim shakes with the lump.
        top = max(-shape.half_height, (-v - dy) / size)
        bottom = min(shape.half_height, (min(self.geometry.rim_row, self.spec.height - dy) - v) / size)
        visibility = shape.share_between(top, bottom) if bottom > top else 0.0
        on_belt = rock.released_at is None
        if visibility < (_SEEN if on_belt and v < self.geometry.cv else _SWALLOWED):
            return None
        left, right = shape.extent_between(top, bottom)
        ahead = (rock.release_y - rock.y) / self.spec.belt_speed_mm_s
        return Truth(
            id=rock.id,
            x=u + dx + left * size,
            y=max(v + dy + top * size, 0.0),
            w=(right - left) * size,
            h=(bottom - top) * size,
            size_mm=rock.size_mm,
            on_belt=on_belt,
            model="belt" if on_belt else "fall",
            visibility=visibility,
            seconds_to_lip=ahead if on_belt else -rock.fallen_s,
        )
