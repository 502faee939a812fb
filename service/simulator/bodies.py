"""Rocks as convex bodies, drawn with shading and cast shadow from any side.

A body is the set {x : n_i . x <= d_i}, its longest diameter 1. Seen from the direction w, the surface at
(u, v) lies at w = min over n_iw > 0 of (d_i - n_iu u - n_iv v) / n_iw, and the plane that attains the
minimum gives the normal. Texture is a sum of waves in the body's own coordinates, so it turns with it.
World axes: x across the belt, y along its travel (towards the camera), z up. Picture axes: u to the
right, v down, w towards the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial import HalfspaceIntersection

from lumpwatch.service.simulator.noise import Field
from lumpwatch.service.simulator.shape import Shape, filled

Vector = NDArray[np.float64]
_PAD = 0.42  # room for the shadow, in diameters


@dataclass(frozen=True)
class View:
    """Where camera and light are. `elevation` is the angle (rad) by which the camera looks down."""

    elevation: float
    light: Vector
    """Unit vector (3,) towards the light, world axes."""

    def to_picture(self) -> Vector:
        """The rotation from world to picture axes, 3x3."""
        s, c = math.sin(self.elevation), math.cos(self.elevation)
        return np.array([[1.0, 0, 0], [0, s, -c], [0, c, s]])


@dataclass(frozen=True)
class Body:
    """A convex body and its surface. Arrays in its own axes; the third points up when it lies still."""

    normals: Vector
    """(n, 3) unit normals of its planes."""
    offsets: Vector
    """(n,) distances of the planes from the origin."""
    corners: Vector
    """(m, 3)."""
    waves: Vector
    """(k, 5): wave vector, phase and amplitude of the texture."""
    brightness: float
    rough: float
    worn: float
    """Over how much of the diameter its edges are rounded."""
    fines: float
    """How much of its upper side is covered with fines, 0..1."""


@dataclass(frozen=True)
class _Kind:
    planes: int
    depth: tuple[float, float]
    axes: tuple[float, float, float]
    brightness: float
    rough: float
    worn: float
    fines: float


_KINDS = {
    "rock": _Kind(24, (0.80, 1.0), (1.0, 0.85, 0.72), 1.0, 0.30, 0.012, 0.0),
    "frozen": _Kind(60, (0.84, 1.0), (1.0, 0.88, 0.75), 0.62, 0.9, 0.012, 0.6),
    "smooth": _Kind(220, (0.985, 1.0), (1.0, 0.88, 0.72), 1.08, 0.06, 0.07, 0.0),
    "slab": _Kind(9, (0.8, 1.0), (1.0, 0.76, 0.30), 1.0, 0.22, 0.008, 0.0),
}


def body(rng: Generator, kind: str = "rock") -> Body:
    """A random body: `rock`, `frozen`, `smooth` or `slab`."""
    what = _KINDS[kind]
    normals = _directions(rng, what.planes, flat=kind == "slab")
    offsets = rng.uniform(*what.depth, len(normals))
    axes = np.array(what.axes) * rng.uniform(0.92, 1.08, 3)
    # Stretched by its axes: n . (x / axes) <= d.
    normals = normals / axes
    length = np.linalg.norm(normals, axis=1)
    normals, offsets = normals / length[:, None], offsets / length
    spaces = np.hstack((normals, -offsets[:, None]))
    corners = np.asarray(HalfspaceIntersection(spaces, np.zeros(3)).intersections, float)
    longest = math.sqrt(float(((corners[:, None] - corners[None]) ** 2).sum(-1).max()))
    k = rng.normal(0, 1, (14, 3))
    k *= (np.geomspace(9, 75, 14) / np.linalg.norm(k, axis=1))[:, None]
    waves = np.column_stack((k, rng.uniform(0, 2 * math.pi, 14), np.geomspace(1.0, 0.55, 14)))
    brightness = what.brightness * rng.uniform(0.92, 1.08)
    surface = (what.rough, what.worn, what.fines)
    return Body(normals, offsets / longest, corners / longest, waves, brightness, *surface)


def turned(yaw: float, roll: float = 0.0) -> Vector:
    """The rotation from body to world axes: about the upright, then rolled towards the camera."""
    cy, sy, cr, sr = math.cos(yaw), math.sin(yaw), math.cos(roll), math.sin(roll)
    upright = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    return np.array([[1.0, 0, 0], [0, cr, sr], [0, -sr, cr]]) @ upright


def silhouette(solid: Body, rotation: Vector, view: View) -> tuple[Vector, Vector]:
    """(n, 2) outline in the picture around the middle of its box, and that middle, (2,)."""
    seen = solid.corners @ (view.to_picture() @ rotation).T
    hull = cv2.convexHull(seen[:, :2].astype(np.float32))[:, 0].astype(float)
    middle = (hull.min(0) + hull.max(0)) / 2
    return hull - middle, middle


def draw_body(solid: Body, rotation: Vector, view: View, texels: float, ore: Field | None = None) -> Shape:
    """The body as seen; `texels` is its longest diameter, `ore` a tile of ore that serves as fines."""
    to_picture = view.to_picture() @ rotation
    outline, middle = silhouette(solid, rotation, view)
    side = 2 * math.ceil(texels * (0.5 + _PAD))
    mask = filled(outline * texels + side / 2, side)
    half = np.ceil(np.abs(outline).max(0) * texels).astype(int) + 1
    y0, y1, x0, x1 = side // 2 - half[1], side // 2 + half[1], side // 2 - half[0], side // 2 + half[0]
    v, u = (np.indices((y1 - y0, x1 - x0), dtype=np.float32) + 0.5) / np.float32(texels)
    u, v = u + np.float32(middle[0] - half[0] / texels), v + np.float32(middle[1] - half[1] / texels)
    window = _surface(solid, to_picture, view, u, v, ore)
    grey = np.zeros((side, side), np.float32)
    grey[y0:y1, x0:x1] = window
    shadow = _shadow(solid, rotation, view, texels, side, middle)
    sprite = np.dstack((grey * mask, mask, shadow * (1 - mask))).astype(np.float32)
    return Shape.of_outline(outline, sprite, texels)


def _surface(solid: Body, to_picture: Vector, view: View, u: Field, v: Field, ore: Field | None) -> Field:
    """Grey levels of the body on a grid of picture coordinates."""
    planes = solid.normals @ to_picture.T
    front = planes[:, 2] > 1e-3
    facing, offsets = planes[front].astype(np.float32), solid.offsets[front].astype(np.float32)
    depth, index = np.full(u.shape, np.inf, np.float32), np.zeros(u.shape, np.intp)
    for i, (plane, offset) in enumerate(zip(facing, offsets, strict=True)):
        w = (offset - plane[0] * u - plane[1] * v) / plane[2]
        nearer = w < depth
        depth[nearer], index[nearer] = w[nearer], i
    worn = max(solid.worn * max(u.shape), 0.4)
    normal = np.asarray(cv2.GaussianBlur(facing[index], (0, 0), worn), np.float32)
    own = np.stack((u, v, np.minimum(depth, 2)), -1) @ to_picture.astype(np.float32)
    k, phase, size = solid.waves[:, :3], solid.waves[:, 3], solid.waves[:, 4]
    turn = own @ k.T.astype(np.float32) + phase.astype(np.float32)
    texture = np.sin(turn) @ (size / len(size)).astype(np.float32)
    slopes = (size / np.linalg.norm(k, axis=1) * solid.rough)[:, None] * (k @ to_picture.T)
    normal = normal + np.cos(turn) @ slopes.astype(np.float32) * np.float32(0.22)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light = (view.to_picture() @ view.light).astype(np.float32)
    lit = np.clip(normal @ light, 0, None)
    sky = 0.5 + 0.5 * (normal @ view.to_picture()[:, 2].astype(np.float32))
    grey = 152 * (0.12 + 0.22 * sky + 0.78 * lit) * (1 + (0.5 + 0.6 * solid.rough) * 0.4 * texture)
    grey *= solid.brightness * (0.6 + 0.4 * _above_ground(solid, to_picture, view, v, depth))
    if solid.fines > 0 and ore is not None:
        upper = (normal @ to_picture.astype(np.float32))[..., 2] - 1 + 1.1 * solid.fines + 0.9 * texture
        cover = np.clip(4 * upper, 0, 1)
        grey += cover * (ore[: u.shape[0], : u.shape[1]] - grey)
    return np.asarray(np.clip(grey, 4, 250), np.float32)


def _above_ground(solid: Body, to_picture: Vector, view: View, v: Field, depth: Field) -> Field:
    """0 where the body touches the ore, 1 well above it: less light comes in there."""
    up = view.to_picture()[:, 2]
    ground = float((solid.corners @ to_picture.T @ up).min())
    height = up[1] * v + up[2] * np.minimum(depth, 2) - ground
    return np.asarray(np.clip(height / 0.16, 0, 1), np.float32)


def _shadow(solid: Body, rotation: Vector, view: View, texels: float, side: int, middle: Vector) -> Field:
    """Darkness of the shadow on the ground, 0..1."""
    corners = solid.corners @ rotation.T
    height = corners[:, 2:] - corners[:, 2].min()
    ground = corners - height * view.light / view.light[2]
    seen = (ground @ view.to_picture().T)[:, :2] - middle
    hull = cv2.convexHull(seen.astype(np.float32))[:, 0].astype(float)
    dark = filled(hull * texels + side / 2, side)
    return 0.62 * np.asarray(cv2.GaussianBlur(dark, (0, 0), max(texels / 45, 0.5)), np.float32)


def _directions(rng: Generator, n: int, flat: bool) -> Vector:
    """Unit vectors spread over the sphere; `flat`: around the equator, with the two poles."""
    i = np.arange(n) + rng.uniform(-0.25, 0.25, n)
    if flat:
        angle, tilt = 2 * math.pi * i / n, rng.uniform(-0.25, 0.25, n)
        ring = np.stack((np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)), -1)
        poles = np.array([[0, 0, 1.0], [0, 0, -1.0]]) + rng.uniform(-0.12, 0.12, (2, 3))
        found = np.vstack((ring, poles))
    else:
        z = 1 - 2 * np.clip((i + 0.5) / n, 0.01, 0.99)
        angle = math.pi * (3 - math.sqrt(5)) * np.arange(n) + rng.uniform(-0.3, 0.3, n)
        found = np.stack((np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z), -1)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True), float)
