"""A camera over a belt: pinhole, square pixels, the principal point in the middle.

A point (x, y) of the belt, measured from where the optical axis meets it, y towards the camera, is seen at

    u = c_u + f x / Z,   v = c_v + f y cos(tilt) / Z,   Z = D - y sin(tilt),

turned by a small roll about the middle of the picture. Lengths are pixels of the strip until a calibration asks
for millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class View:
    """What a camera sees of a belt."""

    width: int
    height: int
    """Of the picture."""
    belt: int
    """Width of the strip, pixels of the strip."""
    near: float = 0.85
    """Width of the belt at the bottom of the picture, share of the picture's."""
    tilt_deg: float = 0.0
    """0: straight from above."""
    angle_deg: float = 55.0
    """Horizontal angle of view."""
    yaw_deg: float = 0.0
    """The belt's turn in its plane."""
    roll_deg: float = 0.0
    shift: float = 0.0
    """The belt's middle beside the optical axis, in widths of the belt."""
    top: float = 0.03
    bottom: float = 0.97
    """The region of interest, shares of the picture's height."""

    @property
    def focal(self) -> float:
        """Pixels."""
        return self.width / 2 / np.tan(np.radians(self.angle_deg) / 2)

    def matrix(self) -> Matrix:
        """Homography from the strip's window (x right from its edge, y down from the axis) to the picture."""
        tilt, f = np.radians(self.tilt_deg), self.focal
        low = self.height / 2 / f
        depth = f * self.belt / (self.near * self.width)
        distance = depth * (np.cos(tilt) + low * np.sin(tilt)) / np.cos(tilt)
        camera = np.array([[f, 0, 0], [0, f * np.cos(tilt), 0], [0, -np.sin(tilt), distance]])
        yaw = np.radians(self.yaw_deg)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        centre = np.array([[1, 0, self.belt * (self.shift - 0.5)], [0, 1, 0], [0, 0, 1]], float)
        roll = np.radians(self.roll_deg)
        c, s = np.cos(roll), np.sin(roll)
        rolled = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], float)
        middle = np.array([[1, 0, self.width / 2], [0, 1, self.height / 2], [0, 0, 1]])
        return np.asarray(middle @ rolled @ camera @ turn @ centre)

    def rows(self) -> tuple[float, float]:
        """The part of the strip's window, along y, that the picture shows, with a margin."""
        corners = np.array([[0, 0], [self.width, 0], [self.width, self.height], [0, self.height]], float)
        seen = project(_inverse(self.matrix()), corners)
        return float(seen[:, 1].min()) - 8, float(seen[:, 1].max()) + 8

    def along(self, share: float) -> float:
        """The y at which the middle of the belt is at a share of the picture's height."""
        matrix = self.matrix()
        low, high = self.rows()
        ys = np.linspace(low, high, 400)
        seen = project(matrix, np.column_stack([np.full(400, self.belt / 2), ys]))
        return float(np.interp(share * self.height, seen[:, 1], ys))

    def polygon(self) -> list[list[float]]:
        """The region of interest, shares of the picture."""
        low, high = self.along(self.top), self.along(self.bottom)
        corners = np.array([[0, low], [self.belt, low], [self.belt, high], [0, high]], float)
        seen = project(self.matrix(), corners) / (self.width, self.height)
        return [[round(float(x), 4), round(float(y), 4)] for x, y in np.clip(seen, 0, 1)]

    def calibration(
        self, mm: float, limit_mm: float, rng: np.random.Generator | None = None
    ) -> dict[str, object]:
        """Four points of the belt as a person would click them; `mm` is the size of a pixel of the strip."""
        low, high = self.along(0.15), self.along(0.85)
        places = np.array([[0.05, low], [0.95, low], [0.95, high], [0.05, high]]) * (self.belt, 1)
        lip = np.array([[0.1, self.along(self.bottom)], [0.9, self.along(self.bottom)]]) * (self.belt, 1)

        def clicked(points: Points) -> list[list[float]]:
            seen = project(self.matrix(), points)
            if rng is not None:
                seen = seen + rng.uniform(-1.0, 1.0, seen.shape)
            shares = np.clip(np.round(seen) / (self.width, self.height), 0, 1)
            return [[round(float(x), 5), round(float(y), 5)] for x, y in shares]

        millimetres = (places - places[0]) * mm
        return {
            "points": clicked(places),
            "points_mm": [[round(float(x), 1), round(float(y), 1)] for x, y in millimetres],
            "lip": clicked(lip),
            "limit_mm": round(limit_mm, 1),
        }


def project(matrix: Matrix, points: NDArray[np.floating]) -> Points:
    """Points (n, 2) through a homography."""
    seen = cv2.perspectiveTransform(points.reshape(-1, 1, 2).astype(np.float64), matrix)
    return np.asarray(seen, np.float64).reshape(-1, 2)


def _inverse(matrix: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(matrix), np.float64)


def fineness(view: View) -> NDArray[np.float32]:
    """Pixels of the strip that a pixel of the picture spans (h, w), the longer way."""
    back = _inverse(view.matrix())
    v, u = np.mgrid[0 : view.height : 8, 0 : view.width : 8].astype(float)
    at = np.column_stack([u.ravel(), v.ravel()])
    here = project(back, at)
    right, down = (np.linalg.norm(project(back, at + step) - here, axis=1) for step in ((1, 0), (0, 1)))
    # A mean of both ways: the longer one alone blurs the other.
    span = np.sqrt(right * down).reshape(v.shape)
    return np.asarray(cv2.resize(span.astype(np.float32), (view.width, view.height)))
