"""The simulated feed: pictures of a crusher's belt, and the truth about the lumps in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.codec import ThinLink
from lumpwatch.service.simulator.gaps import Gaps
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.mouth import Bridge, MouthTruth
from lumpwatch.service.simulator.scene import Scene
from lumpwatch.service.simulator.site import Site
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.stock import Stock
from lumpwatch.service.simulator.traffic import Rock, Traffic
from lumpwatch.service.simulator.weather import Weather

_SEEN, _SWALLOWED = 0.5, 0.4  # labels start and end at these shares of what is not buried


@dataclass(frozen=True, slots=True)
class Truth:
    """A lump in one picture.

    x, y, w, h is the box of its visible part in pixels of the whole picture, x and y the upper left
    edge. `visibility` is the share of the lump below the picture's upper border, above the rim of the
    crusher and not buried; what lies in front of it is not counted. `size_mm` is the longest diameter of
    the whole lump: in style a that of its outline, but for bodies (style b, the named kinds, lumps that
    roll) that in space. `seconds_to_lip` is the time until its front edge is at the lip if the belt keeps
    its speed; past the lip it is the negative time since then.
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


@dataclass(frozen=True, slots=True)
class BeltTruth:
    """What the belt does at a moment."""

    speed_mm_s: float
    load: float
    """Share of the visible belt, from the top of the picture to the lip, on which ore lies."""


class FeedSimulator:
    """Renders a feed frame by frame; frame i shows the moment i / fps."""

    def __init__(self, spec: FeedSpec) -> None:
        self.spec = spec
        self.geometry = Geometry.of(spec)
        self._belt = BeltMotion(spec)
        site = Site(spec, self.geometry)
        self._gaps = Gaps(spec)
        self._scene = Scene(spec, self.geometry, self._belt, site, self._gaps)
        self._weather = Weather(spec, site.light(), self.geometry.lip_row)
        stock = Stock(spec, self.geometry, site.view, self._scene.bed)
        self._traffic = Traffic(spec, self.geometry, self._belt, stock, self._gaps)
        self._tint = site.tint()
        self._link = ThinLink(spec) if spec.h264_crf is not None else None
        self._frame = 0

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
        return self._relative(self.geometry.outline())

    @property
    def belt_polygon(self) -> tuple[tuple[float, float], ...]:
        """Outline of the belt alone, to the lip, relative to the picture (0..1)."""
        outline = self.geometry.outline()
        return self._relative(outline[[0, 1, 2, 5]])

    @property
    def mouth_polygon(self) -> tuple[tuple[float, float], ...]:
        """Outline of the mouth, between lip and rim, relative to the picture (0..1)."""
        outline = self.geometry.outline()
        return self._relative(outline[[5, 2, 3, 4]])

    def _relative(self, corners: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
        size = (self.spec.width, self.spec.height)
        return tuple((float(u), float(v)) for u, v in np.clip(corners / size, 0, 1).round(4))

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
        if self._link is not None:
            picture = self._link.through(picture, self._frame)
        truths = tuple(truth for r in rocks if r.id and (truth := self.truth(r, t, dx, dy)) is not None)
        self._frame += 1
        return picture, truths

    def belt_at(self, t: float) -> BeltTruth:
        """What the belt does at time t."""
        distance, length = self._belt.distance(t), self.spec.belt_length_mm
        cover = self._gaps.cover(distance - (np.arange(200) + 0.5) * length / 200)
        return BeltTruth(self._belt.speed(t), float(cover.mean()))

    def mouth_at(self, t: float) -> MouthTruth:
        """What the crusher's mouth does at time t."""
        return self._scene.mouth.at(t)

    @property
    def bridges(self) -> tuple[Bridge, ...]:
        """The bridges that have formed in the mouth so far."""
        return tuple(self._scene.mouth.bridges)

    @property
    def lodged(self) -> tuple[tuple[int, float, float], ...]:
        """The lumps that have lodged in the mouth so far: id, when they came to rest, and when they go through."""
        stay = self.spec.stuck_duration_s
        return tuple((number, at, at + stay) for number, at in self._traffic.lodged)

    def skip(self, frames: int = 1) -> None:
        """Pass over pictures without drawing them; what follows is what would have followed.

        With `h264_crf` that holds from the next full second on: until then another key frame is behind it.
        """
        self._frame += frames

    def truth(self, rock: Rock, t: float, dx: float = 0.0, dy: float = 0.0) -> Truth | None:
        """The label of a rock at time t in a picture that is moved by dx and dy px; None where too little shows."""
        u, v, scale = self.geometry.project(rock.x, rock.y, rock.z)
        size, shape = rock.size_mm * scale, rock.shape
        # In units of the lump's diameter, from the middle of its box. The picture's upper border
        # cuts after the vibration, the rim before it: the rim shakes with the lump.
        top = max(-shape.half_height, (-v - dy) / size)
        bottom = min(shape.half_height, (min(self.geometry.rim_row, self.spec.height - dy) - v) / size)
        inside = shape.share_between(top, bottom) if bottom > top else 0.0
        on_belt = rock.released_at is None
        if inside < (_SEEN if on_belt and v < self.geometry.cv else _SWALLOWED):
            return None
        left, right = shape.extent_between(top, bottom)
        x, w = u + dx + left * size, (right - left) * size
        if x < 0 or x + w > self.spec.width:  # a camera that was knocked looks past the belt
            x, w = max(x, 0.0), min(x + w, self.spec.width) - max(x, 0.0)
        speed = (1 + rock.slip) * self._belt.running_speed(t)
        return Truth(
            id=rock.id,
            x=x,
            y=max(v + dy + top * size, 0.0),
            w=w,
            h=(bottom - top) * size,
            size_mm=rock.size_mm,
            on_belt=on_belt,
            model="belt" if on_belt else "fall",
            visibility=inside * shape.shown,
            seconds_to_lip=(rock.release_y - rock.y) / speed if on_belt else -rock.fallen_s,
        )
