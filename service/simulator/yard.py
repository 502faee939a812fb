"""What does not move in style b: a belt conveyor in a yard, with idlers, stringers and a chute."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.noise import Field, smooth_noise

_Point = tuple[float, float, float]


def yard(geometry: Geometry, rng: Generator, width: int, height: int) -> NDArray[np.uint8]:
    """(height, width) grey picture of everything but the ore."""
    ground = smooth_noise(rng, (height, width), height / 10)
    gravel = smooth_noise(rng, (height, width), 2.2)
    canvas = np.full((height, width), 108, np.float32) + 9 * ground + 8 * gravel
    for side in (-1, 1):
        _side(canvas, geometry, side, height)
    _chute(canvas, geometry)
    canvas += 1.5 * gravel
    _beam(canvas, geometry, ground)
    return np.asarray(np.clip(canvas, 0, 255), np.uint8)


def daylight(geometry: Geometry, width: int, height: int) -> Field:
    """(height, width) factor on the light: brighter to one side, dark in the chute."""
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    light = 1.08 - 0.22 * x - 0.10 * y
    rows = np.arange(height, dtype=float)[:, None]
    depth = np.clip((rows - geometry.lip_row) / (geometry.rim_row - geometry.lip_row), 0, 1)
    return np.where(rows < geometry.rim_row, light * (1 - 0.6 * depth), light).astype(np.float32)


def _face(canvas: Field, geometry: Geometry, corners: list[_Point], grey: float) -> None:
    points = np.array([geometry.project(*corner)[:2] for corner in corners])
    cv2.fillPoly(canvas, [np.round(points * 16).astype(np.int32)], grey, cv2.LINE_AA, 4)


def _side(canvas: Field, geometry: Geometry, side: int, height: int) -> None:
    """Shadow on the ground, stringer with posts, idlers that stick out, and a low lip of rubber."""
    far, near = -500.0, geometry.belt_length_mm
    edge = side * geometry.belt_width_mm / 2

    def strip(a: float, b: float, z: float, grey: float) -> None:
        corners = [(edge + side * a, far, z), (edge + side * b, far, z)]
        corners += [(edge + side * b, near, z), (edge + side * a, near, z)]
        _face(canvas, geometry, corners, grey)

    strip(0, 520, -150, 62)
    strip(330, 420, -60, 118)
    strip(405, 420, -60, 70)
    for y in np.arange(0.0, near, 450.0):
        roller = [(edge, y, -70.0), (edge + side * 330, y, -10.0)]
        roller += [(edge + side * 330, y + 110, -10.0), (edge, y + 110, -70.0)]
        _face(canvas, geometry, roller, 92)
        shine = [(edge, y + 25, -65.0), (edge + side * 330, y + 25, -5.0)]
        shine += [(edge + side * 330, y + 55, -5.0), (edge, y + 55, -65.0)]
        _face(canvas, geometry, shine, 168)
        u, v, scale = geometry.project(edge + side * 375, y + 55, -60)
        cv2.circle(canvas, (round(u), round(v)), max(round(30 * scale), 1), 48, -1, cv2.LINE_AA)
    strip(0, 55, 60, 34)


def _chute(canvas: Field, geometry: Geometry) -> None:
    """The opening under the lip, between two plates with ribs."""
    height, width = canvas.shape
    lip = round(geometry.lip_row)
    left, _, scale = geometry.project(-geometry.belt_width_mm / 2, geometry.belt_length_mm)
    right = 2 * geometry.cu - left
    canvas[lip:] = 96
    for u in np.arange(0.0, width, max(160 * scale, 8.0)):
        cv2.line(canvas, (round(u), lip), (round(u), height), 70, max(height // 200, 1), cv2.LINE_AA)
    canvas[lip:, max(round(left - 90 * scale), 0) : round(right + 90 * scale)] = 26
    cv2.line(canvas, (0, lip), (width, lip), 140, max(height // 240, 1))


def _beam(canvas: Field, geometry: Geometry, ground: Field) -> None:
    """The near edge of the crusher: a beam with hazard stripes."""
    height, width = canvas.shape
    top = geometry.rim_row
    y, x = np.mgrid[top:height, :width]
    stripe = (x + y) % max(height // 9, 8) < max(height // 18, 4)
    canvas[top:] = np.where(stripe, 178, 48) + 6 * ground[top:]
