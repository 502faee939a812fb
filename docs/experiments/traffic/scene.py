"""Generated traffic with truth: a road seen from above its end, 360 x 240 pixels, 30 pictures a second.

Two streams move down the picture, one straight and one from the left, and grow as they come nearer. Some
riders go the wrong way between the lanes and pass the others closely; some overtake so closely that
they touch for a while. The background is textured, every picture has its own noise, and the light drifts. The
road is empty in the first picture, or in all pictures from which the background is learned.
The same seed gives the same pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

Array = NDArray[np.float64]
HEIGHT, WIDTH, RATE = 240, 360, 30.0
LEARNING, FRAMES = 30, 330
MOST = 9
"""Objects at a time, at most."""
DIRECTION = (0.17, 1.0)
"""Between the two streams."""
STRAIGHT, SLANTED = 0.0, 0.35
RIDER_LANES = (
    (150.0, STRAIGHT),
    (178.0, STRAIGHT),
    (206.0, STRAIGHT),
    (234.0, STRAIGHT),
    (20.0, SLANTED),
    (48.0, SLANTED),
)
CAR_LANE = (310.0, STRAIGHT)
WRONG_LANES = ((266.0, STRAIGHT), (34.0, SLANTED))
"""Column at the top row and columns gained a row; the second lies between two lanes 28 px apart."""
COLOURS = (
    (40, 40, 200),
    (190, 70, 30),
    (40, 150, 40),
    (30, 190, 210),
    (200, 200, 205),
    (30, 30, 35),
    (160, 40, 140),
)
NOISE = 3.0


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One object and its whole way."""

    id: int
    wrong_way: bool
    patch: Array
    """Its looks at scale 1, BGR and opacity (h, w, 4)."""
    first: int
    """Frame in which the first box of `boxes` is."""
    boxes: Array
    """Centre x, y, width, height (n, 4)."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """One sequence; `pictures` draws it."""

    seed: int
    vehicles: tuple[Vehicle, ...]

    def truth(self, frame: int) -> list[tuple[Vehicle, Array, float]]:
        """Vehicles in a frame, their boxes cut to the picture, and the share of each that is visible."""
        seen = []
        for vehicle in self.vehicles:
            k = frame - vehicle.first
            if 0 <= k < len(vehicle.boxes):
                box = clipped(vehicle.boxes[k : k + 1])[0]
                share = float(box[2] * box[3] / (vehicle.boxes[k, 2] * vehicle.boxes[k, 3]))
                if share > 0.0:
                    seen.append((vehicle, box, share))
        return seen

    def pictures(self) -> Iterator[Image]:
        """All pictures, BGR, in order."""
        rng = np.random.default_rng([self.seed, 1])
        road = _road(rng)
        noise = rng.normal(0.0, NOISE, (8, HEIGHT, WIDTH, 3)).astype(np.float32)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        for frame in range(FRAMES):
            picture = road.copy()
            for vehicle in self.vehicles:
                k = frame - vehicle.first
                if 0 <= k < len(vehicle.boxes):
                    _paste(picture, vehicle.patch, vehicle.boxes[k])
            picture *= 1.0 + 0.03 * np.sin(phase + 2.0 * np.pi * frame / RATE / 7.0)
            shift = rng.integers(0, (HEIGHT, WIDTH))
            picture += np.roll(noise[rng.integers(len(noise))], shift, axis=(0, 1))
            yield np.clip(np.round(picture), 0, 255).astype(np.uint8)


def clipped(boxes: Array) -> Array:
    """Boxes (n, 4) by their centre, cut to the picture; none is thinner than nothing."""
    limit = np.array([WIDTH, HEIGHT], dtype=float)
    low = np.clip(boxes[:, :2] - 0.5 * boxes[:, 2:], 0.0, limit)
    high = np.clip(boxes[:, :2] + 0.5 * boxes[:, 2:], 0.0, limit)
    return np.hstack([0.5 * (low + high), high - low])


def make_sequence(seed: int, empty: int, wrong_ways: int = 2) -> Sequence:
    """Up to `MOST` objects at a time, `wrong_ways` riders against them; nothing comes in the first `empty` frames."""
    rng = np.random.default_rng([seed, 0])
    lanes = [*RIDER_LANES, CAR_LANE]
    ahead: dict[int, Array] = {}
    starts = np.sort(rng.integers(LEARNING, FRAMES - 90, wrong_ways))
    side = int(rng.integers(2))
    vehicles: list[Vehicle] = []

    def add(frame: int, lane: tuple[float, float], speed: float, car: bool, wrong: bool) -> Array:
        patch = _car(rng) if car else _rider(rng)
        boxes = _way(lane, speed, patch.shape[:2], wrong)
        vehicles.append(Vehicle(len(vehicles) + 1, wrong, patch, frame, boxes[: FRAMES - frame]))
        return boxes

    for frame in range(empty, FRAMES):
        for nth in np.flatnonzero(starts == frame):  # on either side in turn: none overtakes another
            add(frame, WRONG_LANES[(side + int(nth)) % 2], rng.uniform(50.0, 90.0), False, True)
        busy = sum(v.first <= frame < v.first + len(v.boxes) for v in vehicles)
        if busy + 2 >= MOST or rng.random() > 6.0 / RATE:
            continue
        k = int(rng.integers(len(lanes)))
        speed = rng.uniform(55.0, 90.0)
        if k in ahead and frame < ahead[k][0] + ahead[k][1] / speed * RATE:
            continue
        car = k == len(RIDER_LANES)
        boxes = add(frame, lanes[k], speed, car, False)
        # The next in the lane enters once it cannot run into this one on the way, at whatever speed.
        gap = 60.0 if car else 45.0
        ahead[k] = np.array([float(frame), max(gap, (len(boxes) / RATE - 2.4) * speed + gap)])
        if not car and k < 3 and rng.random() < 0.2:  # another one overtakes, closely enough to touch
            x, slope = lanes[k]
            add(frame + int(rng.integers(30, 40)), (x + 12.5, slope), 1.5 * speed, False, False)
    return Sequence(seed, tuple(v for v in vehicles if len(v.boxes)))


def _way(lane: tuple[float, float], speed: float, shape: tuple[int, int], wrong: bool) -> Array:
    """Boxes from one edge of the picture to the other; nearer is larger and faster."""
    y = HEIGHT + 20.0 if wrong else -20.0
    boxes = []
    while -20.0 <= y <= HEIGHT + 20.0:
        scale = 0.75 + 0.5 * y / HEIGHT
        x = lane[0] + lane[1] * y
        boxes.append((x, y, shape[1] * scale, shape[0] * scale))
        y += (-1.0 if wrong else 1.0) * speed * scale / RATE
    return np.array(boxes)


def _road(rng: np.random.Generator) -> NDArray[np.float32]:
    fine = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 1.0)
    coarse = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 14.0)
    gray = 112.0 + 9.0 * fine / fine.std() + 10.0 * coarse / coarse.std()
    road = np.repeat(gray[:, :, None], 3, axis=2)
    rows = np.arange(HEIGHT)
    for x, slope in ((136.0, STRAIGHT), (286.0, STRAIGHT), (6.0, SLANTED)):  # markings
        for row in rows[rows % 40 < 24]:
            column = round(x + slope * row)
            road[row, max(column, 0) : column + 3] = 205.0
    road[:, 345:] = (70.0, 120.0, 80.0) + 12.0 * rng.standard_normal((HEIGHT, 15, 1))  # grass
    return road.astype(np.float32)


def _rider(rng: np.random.Generator) -> Array:
    """A motorcycle and its rider from the front: helmet, shirt, machine."""
    w, h = int(rng.integers(12, 16)), int(rng.integers(22, 28))
    shirt, machine, helmet = (
        np.array(COLOURS[k], dtype=float) for k in rng.choice(len(COLOURS), 3, replace=False)
    )
    patch = np.zeros((h, w, 4))
    patch[: h // 4, :, :3], patch[h // 4 : h // 2, :, :3], patch[h // 2 :, :, :3] = helmet, shirt, machine
    patch[-h // 6 :, :, :3] = 35.0
    patch[:, :, :3] += 18.0 * rng.standard_normal((h, w, 1))
    for top, bottom, half in ((0.0, 0.3, 0.28), (0.22, 0.72, 0.5), (0.6, 1.0, 0.33)):
        centre = (round(8 * (w - 1)), round(8 * (top + bottom) * (h - 1)))
        axes = (round(16 * half * w), round(16 * 0.5 * (bottom - top) * h))
        opacity = np.zeros((h, w), np.uint8)
        cv2.ellipse(opacity, centre, axes, 0.0, 0.0, 360.0, 1, -1, shift=4)
        patch[:, :, 3] = np.maximum(patch[:, :, 3], opacity)
    return patch


def _car(rng: np.random.Generator) -> Array:
    w, h = int(rng.integers(26, 31)), int(rng.integers(34, 40))
    patch = np.empty((h, w, 4))
    patch[:, :, :3] = COLOURS[rng.integers(len(COLOURS))]
    patch[h // 5 : h // 2, 3 : w - 3, :3] = (90.0, 70.0, 60.0)
    patch[-5:, :, :3] = 40.0
    patch[:, :, :3] += 15.0 * rng.standard_normal((h, w, 1))
    patch[:, :, 3] = 1.0
    return patch


def _paste(picture: NDArray[np.float32], patch: Array, box: Array) -> None:
    """Blend a patch, scaled to the box, into the picture at a fraction of a pixel."""
    corner = box[:2] - 0.5 * box[2:]
    low = np.maximum(np.floor(corner).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corner + box[2:]).astype(int) + 2, (WIDTH, HEIGHT))
    if np.any(high <= low):
        return
    scale = box[2] / patch.shape[1]
    offset = corner - low - 0.5 + 0.5 * scale  # pixel centres lie half a pixel from the corner
    placed = np.array([[scale, 0.0, offset[0]], [0.0, scale, offset[1]]])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    solid = patch * patch[:, :, 3:]
    solid[:, :, 3] = patch[:, :, 3]
    moved = cv2.warpAffine(solid.astype(np.float32), placed, size)
    part = picture[low[1] : high[1], low[0] : high[0]]
    part *= 1.0 - moved[:, :, 3:]
    part += moved[:, :, :3]
