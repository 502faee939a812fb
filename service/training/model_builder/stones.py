"""Bodies to lay on a belt: real rocks, made ones, frozen ore, polygons with any texture."""

from __future__ import annotations

import cv2
import numpy as np

from lumpwatch.service.training.model_builder.stock import Cut, Plane, Stock

_LARGEST_CUT_PX = 420


def any_stone(stock: Stock, length: float, rng: np.random.Generator, ground: Plane) -> Cut:
    """A body whose longest side is `length` px; `ground` is what it lies on, which frozen ore is made of."""
    kind = rng.choice(4, p=(0.42, 0.22, 0.16, 0.20))
    if kind == 0:
        cut = stock.rocks[int(rng.integers(len(stock.rocks)))]
    elif kind == 1:
        cut = stock.made[int(rng.integers(len(stock.made)))]
    elif kind == 2:
        cut = _polygon(_texture(stock, rng), rng)
    else:
        cut = _polygon(_patch(ground, rng), rng)
    return _laid(cut, min(length, _LARGEST_CUT_PX), rng)


def _laid(cut: Cut, length: float, rng: np.random.Generator) -> Cut:
    """Turned, mirrored, stretched, and scaled to a longest side of `length` px."""
    h, w = cut.mask.shape
    angle = rng.uniform(0.0, 2.0 * np.pi)
    stretch = np.exp(rng.normal(0.0, 0.12))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = turn @ np.diag([stretch * rng.choice((-1.0, 1.0)), 1.0 / stretch])
    corners = matrix @ np.array([[-w, w, w, -w], [-h, -h, h, h]]) / 2.0
    reach = corners.max(axis=1)
    # Scaled by the turned box first, then cut to what is left of it.
    factor = length / (2.0 * float(reach.max())) * 1.12
    side_w, side_h = (
        max(5, int(np.ceil(2 * reach[0] * factor)) + 2),
        max(5, int(np.ceil(2 * reach[1] * factor)) + 2),
    )
    full = np.hstack([matrix * factor, np.zeros((2, 1))])
    full[:, 2] = np.array([side_w, side_h]) / 2.0 - full[:, :2] @ np.array([w, h]) / 2.0
    shrink = factor < 0.6
    grey, mask = cut.grey, cut.mask
    if shrink:
        sigma = 0.4 / factor
        grey, mask = cv2.GaussianBlur(grey, (0, 0), sigma), cv2.GaussianBlur(mask, (0, 0), 0.7 * sigma)
    grey = cv2.warpAffine(grey, full, (side_w, side_h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    mask = cv2.warpAffine(mask, full, (side_w, side_h), flags=cv2.INTER_LINEAR)
    return Cut(grey, mask)


def _texture(stock: Stock, rng: np.random.Generator) -> Plane:
    """A square of any texture (128, 128), mean 110."""
    kind = int(rng.integers(4))
    if kind == 0:
        rock = stock.rocks[int(rng.integers(len(stock.rocks)))].grey
        h, w = rock.shape
        part = rock[h // 4 : h - h // 4, w // 4 : w - w // 4]
        texture = cv2.resize(part, (128, 128), interpolation=cv2.INTER_CUBIC)
    elif kind == 1:
        texture = _patch(stock.ore[int(rng.integers(len(stock.ore)))].grey, rng)
    else:
        texture = np.zeros((128, 128), np.float32)
        fall_off = float(rng.uniform(0.4, 1.6))
        for octave in range(6):
            side = 3 << octave
            layer = cv2.resize(
                rng.standard_normal((side, side)).astype(np.float32),
                (128, 128),
                interpolation=cv2.INTER_CUBIC,
            )
            texture += layer * 2.0 ** (-fall_off * octave)
        texture = texture * (rng.uniform(3.0, 25.0) / float(texture.std()))
    texture = texture - texture.mean()
    if float(texture.std()) > 40.0:
        texture = texture * (40.0 / float(texture.std()))
    return (110.0 + texture).astype(np.float32)


def _patch(ground: Plane, rng: np.random.Generator) -> Plane:
    side = min(int(rng.integers(60, 180)), *ground.shape)
    y, x = int(rng.integers(ground.shape[0] - side + 1)), int(rng.integers(ground.shape[1] - side + 1))
    return cv2.resize(ground[y : y + side, x : x + side], (128, 128), interpolation=cv2.INTER_AREA)


def _polygon(texture: Plane, rng: np.random.Generator) -> Cut:
    """A body in the outline of a random polygon, lit from one side, its edges worn or sharp."""
    n = int(rng.integers(5, 14))
    angles = np.sort(rng.uniform(0, 2 * np.pi, n))
    radius = 58.0 * rng.uniform(0.62, 1.0, n)
    aspect = rng.uniform(0.6, 1.0)
    points: Plane = np.column_stack([radius * np.cos(angles), aspect * radius * np.sin(angles)]) + 64.0
    if rng.random() < 0.6:
        points = cv2.convexHull(points.astype(np.float32))[:, 0]
    mask = np.zeros((128, 128), np.float32)
    cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 1.0, shift=4)
    if rng.random() < 0.6:
        mask = np.clip((cv2.GaussianBlur(mask, (0, 0), rng.uniform(2.0, 7.0)) - 0.4) * 6.0, 0.0, 1.0)
    depth = cv2.distanceTransform((mask > 0.5).astype(np.uint8), cv2.DIST_L2, 3)
    dome = np.sqrt(np.clip(depth / rng.uniform(6.0, 50.0), 0.0, 1.0))
    slope_y, slope_x = np.gradient(cv2.GaussianBlur(dome.astype(np.float32), (0, 0), 2.0))
    direction = rng.uniform(0, 2 * np.pi)
    shade = 1.0 + rng.uniform(0.0, 6.0) * (np.cos(direction) * slope_x + np.sin(direction) * slope_y)
    shade *= 1.0 - rng.uniform(0.0, 0.5) * (1.0 - dome)
    if rng.random() < 0.5:  # facets
        middle = points.mean(axis=0) + rng.normal(0, 8, 2)
        around = np.arctan2(*(np.indices((128, 128)) - middle[::-1, None, None]))
        cuts = np.sort(rng.uniform(-np.pi, np.pi, int(rng.integers(2, 6))))
        tones = np.exp(rng.normal(0, 0.18, len(cuts) + 1))
        shade = shade * tones[np.searchsorted(cuts, around)]
    return Cut((texture * np.clip(shade, 0.3, 1.8)).astype(np.float32), mask.astype(np.float32))
