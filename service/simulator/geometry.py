"""The camera over the belt: a pinhole, fixed by where the belt lies in the picture.

Belt coordinates in mm: x across (0 in the middle), y along the travel (0 at the top of the picture,
`belt_length_mm` at the lip), z up. The picture of a point is, with w = c y - (b / f) z + 1,

    u = cu + a x / w,    v = cv + (b y + c f z + d) / w,    scale = a / w  [px/mm facing the camera].

For z = 0 that is the belt's homography. Square pixels and a principal point in the middle of the
picture fix the focal length: f^2 = (a^2 - b^2) / c^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lumpwatch.service.simulator.spec import FeedSpec


@dataclass(frozen=True)
class _Layout:
    """Where things lie in the picture, in units of its height; `centre` in units of its width."""

    far_width: float
    near_width: float
    lip: float
    rim: float
    centre: float


_LAYOUTS = {
    "a": _Layout(far_width=0.51, near_width=1.04, lip=0.77, rim=0.95, centre=0.5),
    # Higher above the belt, looking down more steeply, and not over its middle.
    "b": _Layout(far_width=0.52, near_width=0.70, lip=0.82, rim=0.94, centre=0.46),
}


@dataclass(frozen=True)
class Geometry:
    """Projection from belt coordinates (mm) to pixels.

    `lip_row` is where the belt ends, `rim_row` the edge of the crusher behind which falling ore
    vanishes.
    """

    a: float
    b: float
    c: float
    d: float
    cu: float
    cv: float
    focal_px: float
    lip_row: float
    rim_row: int
    belt_width_mm: float
    belt_length_mm: float

    @classmethod
    def of(cls, spec: FeedSpec) -> Geometry:
        """The camera of a feed."""
        layout = _LAYOUTS[spec.style]
        cu, cv = spec.width * layout.centre, spec.height / 2
        lip = layout.lip * spec.height
        length = spec.belt_length_mm
        a = layout.far_width * spec.height / spec.belt_width_mm
        c = (layout.far_width / layout.near_width - 1) / length
        b = ((lip - cv) * (c * length + 1) + cv) / length
        # b < a holds for belts at least twice as long as wide, which the spec demands.
        focal = math.sqrt(a * a - b * b) / -c
        rim = round(layout.rim * spec.height)
        return cls(a, b, c, -cv, cu, cv, focal, lip, rim, spec.belt_width_mm, length)

    def project(self, x: float, y: float, z: float = 0.0) -> tuple[float, float, float]:
        """Pixel u, v and scale (px/mm) of a point in mm."""
        w = self.c * y - self.b / self.focal_px * z + 1
        v = self.cv + (self.b * y + self.c * self.focal_px * z + self.d) / w
        return self.cu + self.a * x / w, v, self.a / w

    def plane(self, z: float) -> NDArray[np.float64]:
        """The 3x3 homography (x, y, 1) mm -> pixels of the plane at height z."""
        w = 1 - self.b / self.focal_px * z
        v = self.c * self.focal_px * z + self.d
        return np.array(
            [
                [self.a, self.cu * self.c, self.cu * w],
                [0.0, self.b + self.cv * self.c, v + self.cv * w],
                [0.0, self.c, w],
            ]
        )

    @cached_property
    def homography(self) -> NDArray[np.float64]:
        """The belt's homography, 3x3: (x, y, 1) mm -> pixels."""
        return self.plane(0.0)

    def to_px(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) points on the belt in mm -> pixels."""
        return _apply(self.homography, points_mm)

    def to_mm(self, points_px: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) pixels -> points on the belt in mm."""
        return _apply(np.asarray(np.linalg.inv(self.homography), float), points_px)

    @property
    def elevation(self) -> float:
        """Angle in radians by which the camera looks down on the belt."""
        return math.asin(self.b / self.a)

    def foreshortening(self, y: float) -> float:
        """Pixels a mm along the belt by pixels a mm facing the camera, at y."""
        w = self.c * y + 1
        return (self.b * w - (self.b * y + self.d) * self.c) / (w * self.a)

    def release_y(self, below_mm: float) -> float:
        """Where (y) a body's centre is when its lower edge, `below_mm` under it, reaches the lip."""
        lip = self.lip_row - self.cv
        return (lip - self.d - self.a * below_mm) / (self.b - self.c * lip)

    def entry_y(self, below_mm: float) -> float:
        """Where (y) a body's centre is when its lower edge enters the picture at the top."""
        return (-self.cv - self.d - self.a * below_mm) / (self.b + self.c * self.cv)

    def outline(self) -> NDArray[np.float64]:
        """(6, 2) corners in pixels of belt and fall, clockwise from the top left."""
        half, length = self.belt_width_mm / 2, self.belt_length_mm
        left, _, _ = self.project(-half, 0)
        lip, _, _ = self.project(-half, length)
        right, lip_right = 2 * self.cu - left, 2 * self.cu - lip
        rim = float(self.rim_row)
        return np.array(
            [
                (left, 0.0),
                (right, 0.0),
                (lip_right, self.lip_row),
                (lip_right, rim),
                (lip, rim),
                (lip, self.lip_row),
            ]
        )


def _apply(matrix: NDArray[np.float64], points: ArrayLike) -> NDArray[np.float64]:
    p = np.asarray(points, float)
    q = p @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(q[..., :2] / q[..., 2:], float)
