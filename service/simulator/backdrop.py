"""What does not move: walls, walkways, the mouth and the rim of the crusher, and the lamps' light."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.noise import Field, smooth_noise

_WALL_MM = 520.0


def backdrop(geometry: Geometry, rng: Generator, width: int, height: int) -> NDArray[np.uint8]:
    """(height, width) grey picture of everything but the ore."""
    grime = smooth_noise(rng, (height, width), height / 16)
    fine = smooth_noise(rng, (height, width), 1.2)
    canvas = np.full((height, width), 46, np.float32) + 5 * grime
    for side in (-1, 1):
        _walkway(canvas, geometry, rng, side)
        _wall(canvas, geometry, side, height)
    _mouth(canvas, geometry)
    canvas += 2.0 * fine + 2.5 * grime
    _rim(canvas, geometry, fine, grime)
    return np.asarray(np.clip(canvas, 0, 255), np.uint8)


def illumination(geometry: Geometry, width: int, height: int) -> Field:
    """(height, width) factor on the light: two lamps over the belt, and the dark of the mouth."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(0, 1, height))
    light = 0.78 + 0.30 * np.exp(-((x + 0.25) ** 2 / 0.5 + (y - 0.30) ** 2 / 0.12))
    light += 0.24 * np.exp(-((x - 0.30) ** 2 / 0.4 + (y - 0.72) ** 2 / 0.10))
    rows = np.arange(height, dtype=float)[:, None]
    depth = np.clip((rows - geometry.lip_row + 4) / (geometry.rim_row - geometry.lip_row), 0, 1)
    mouth = 1 - 0.72 * depth**0.8
    return np.where(rows < geometry.rim_row, light * mouth, light).astype(np.float32)


def _quad(canvas: Field, geometry: Geometry, corners: list[tuple[float, float, float]], grey: float) -> None:
    points = np.array([geometry.project(*corner)[:2] for corner in corners])
    cv2.fillPoly(canvas, [np.round(points * 16).astype(np.int32)], grey, cv2.LINE_AA, 4)


def _line(
    canvas: Field,
    geometry: Geometry,
    ends: tuple[tuple[float, float, float], tuple[float, float, float]],
    grey: float,
    thickness: int = 1,
) -> None:
    a, b = (np.round(np.array(geometry.project(*end)[:2]) * 16).astype(int) for end in ends)
    cv2.line(canvas, tuple(map(int, a)), tuple(map(int, b)), grey, thickness, cv2.LINE_AA, 4)


def _walkway(canvas: Field, geometry: Geometry, rng: Generator, side: int) -> None:
    """A grating beside the wall: a textured plane at the height of the wall's upper edge."""
    texel = 12.0
    rows, columns = int(geometry.belt_length_mm * 1.1 / texel), int(2600 / texel)
    y, x = np.indices((rows, columns))
    plate = 52 + 9.0 * ((x % 9 < 2) | (y % 9 < 2)) - 14.0 * ((x % 100 < 2) | (y % 100 < 2))
    plate = (plate + 6 * smooth_noise(rng, (rows, columns), 20)).astype(np.float32)
    edge = side * (geometry.belt_width_mm / 2 + 150)
    to_mm = np.array([[side * texel, 0, edge], [0, texel, 0], [0, 0, 1]])
    matrix = geometry.plane(_WALL_MM) @ to_mm
    size = (canvas.shape[1], canvas.shape[0])
    warped = cv2.warpPerspective(plate, matrix, size, flags=cv2.INTER_AREA, borderValue=-1)
    np.copyto(canvas, warped, where=warped > 0)


def _wall(canvas: Field, geometry: Geometry, side: int, height: int) -> None:
    """The skirt: an inner face with joints and bolts, and a flange on top."""
    x, length = side * geometry.belt_width_mm / 2, geometry.belt_length_mm
    top, far = _WALL_MM, -600.0
    flange = x + side * 170
    _quad(canvas, geometry, [(x, far, 0), (x, length, 0), (x, length, top), (x, far, top)], 66)
    _quad(canvas, geometry, [(x, far, 0), (x, length, 0), (x, length, 150), (x, far, 150)], 44)
    _quad(canvas, geometry, [(x, far, top), (x, length, top), (flange, length, top), (flange, far, top)], 98)
    _line(canvas, geometry, ((x, far, top), (x, length, top)), 128, max(height // 320, 1))
    _line(canvas, geometry, ((flange, far, top), (flange, length, top)), 34, max(height // 240, 1))
    for y in np.arange(0.0, length, 1000.0):
        _line(canvas, geometry, ((x, y, 0), (x, y, top)), 30)
        _line(canvas, geometry, ((x, y + 25, 0), (x, y + 25, top)), 84)
        _line(canvas, geometry, ((x, y, top), (flange, y, top)), 60)
        for along in (120.0, 370.0, 620.0, 870.0):
            u, v, scale = geometry.project(x + side * 85, y + along, top)
            if y + along < length:
                cv2.circle(canvas, (round(u), round(v)), max(round(22 * scale), 1), 58, -1, cv2.LINE_AA)


def _mouth(canvas: Field, geometry: Geometry) -> None:
    """The opening under the lip, with a steel cheek at both sides."""
    height, width = canvas.shape
    lip, half = geometry.lip_row, geometry.belt_width_mm / 2
    left, _, scale = geometry.project(-half, geometry.belt_length_mm)
    edge = left - 150 * scale
    centre = geometry.cu
    canvas[round(lip) :] = 40 + 0.25 * (canvas[round(lip) :] - 46)
    corners = np.array([(edge, lip), (2 * centre - edge, lip), (2 * centre - edge, height), (edge, height)])
    cv2.fillPoly(canvas, [np.round(corners * 16).astype(np.int32)], 20, cv2.LINE_AA, 4)
    for u in (edge, 2 * centre - edge):
        cv2.line(canvas, (round(u), round(lip)), (round(u), height), 82, max(height // 160, 1), cv2.LINE_AA)
    cv2.line(canvas, (0, round(lip)), (round(edge), round(lip)), 74, max(height // 200, 1))
    cv2.line(canvas, (round(2 * centre - edge), round(lip)), (width, round(lip)), 74, max(height // 200, 1))


def _rim(canvas: Field, geometry: Geometry, fine: Field, grime: Field) -> None:
    """The near edge of the crusher: a worn steel beam across the picture."""
    height, width = canvas.shape
    top = geometry.rim_row
    depth = np.linspace(0, 1, height - top, dtype=np.float32)[:, None]
    canvas[top:] = 92 - 34 * depth + 7 * grime[top:] + 3 * fine[top:]
    bright = max(height // 160, 1)
    canvas[top : top + bright] = 138 + 10 * grime[top : top + bright]
    for u in np.linspace(0, width, 9)[1:-1]:
        cv2.circle(
            canvas, (round(u), (top + height) // 2 + bright), max(height // 120, 2), 44, -1, cv2.LINE_AA
        )
