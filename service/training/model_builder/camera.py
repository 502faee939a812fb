"""From a belt to what a camera shows of it: view, light, weather, lens, sensor, coder."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.training.model_builder.scene import Belt
from lumpwatch.service.training.model_builder.stock import Bytes, Ids, Plane

WIDTH, HEIGHT = 320, 240
"""Of the working picture."""
_FINE = 2
_SEVERE = 0.25
"""How many pictures are taken in any light and weather; the others mostly on an ordinary day."""
_MILD = 0.35
"""How often something befalls a picture of an ordinary day, in units of how often it does otherwise."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A working picture and its truth."""

    grey: Bytes
    ids: Ids
    inside: Bytes
    """1 on the belt."""
    limit_px: NDArray[np.float32]
    """How long a body at the limit is, by row (240,)."""


def shoot(belt: Belt, rng: np.random.Generator) -> Shot:
    """The belt from somewhere, in some light and weather."""
    severity = 1.0 if rng.random() < _SEVERE else _MILD
    view = _view(belt, rng)
    h, w = belt.grey.shape
    fine = (_FINE * WIDTH, _FINE * HEIGHT)
    to_fine = np.diag([_FINE, _FINE, 1.0]) @ view
    double = cv2.warpPerspective(
        belt.grey, np.diag([2.0, 2.0, 1.0]) @ to_fine, (2 * fine[0], 2 * fine[1]), flags=cv2.INTER_LINEAR
    )
    picture = cv2.resize(double, fine, interpolation=cv2.INTER_AREA)
    inside = cv2.warpPerspective(np.ones((h, w), np.float32), to_fine, fine)
    numbers = cv2.warpPerspective(
        belt.ids.astype(np.float32) + 2.0, view, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST, borderValue=2.0
    )
    ids = np.round(numbers).astype(np.int32) - 2
    limit = _limit_by_row(view, belt.limit)
    picture = picture * inside + _structure(fine, rng) * (1.0 - inside)
    picture = _light(picture, rng, severity)
    picture = _weather(picture, rng, severity)
    picture = _sensor(picture, rng, severity)
    working = cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    small = cv2.resize(inside, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) > 0.5
    return Shot(working, np.where(small, ids, 0), small.astype(np.uint8), limit)


def develop(fine: Plane, rng: np.random.Generator) -> Bytes:
    """A picture of twice the working size in some light and weather, as a working picture."""
    picture = _sensor(_weather(_light(fine, rng), rng), rng)
    return np.asarray(cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), np.uint8)


def _view(belt: Belt, rng: np.random.Generator) -> NDArray[np.float64]:
    """The homography from the belt to the working picture."""
    h, w = belt.grey.shape
    if rng.random() < 0.35:  # from above, all of the picture is belt
        zoom = rng.uniform(0.5, 0.8)
        angle = rng.normal(0.0, 0.1)
        turn = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        at = np.array([w / 2, h / 2 + rng.uniform(-0.1, 0.1) * h])
        shift = np.array([WIDTH / 2, HEIGHT / 2]) - turn @ at
        return np.array([[*turn[0], shift[0]], [*turn[1], shift[1]], [0, 0, 1]])
    near = WIDTH * rng.uniform(0.6, 1.25)
    far, middle, tilt = near * rng.uniform(0.3, 1.0), WIDTH * rng.uniform(0.43, 0.57), rng.uniform(-40, 40)
    top, bottom = rng.uniform(-30, 15), HEIGHT + rng.uniform(-10, 40)
    corners = np.array(
        [
            [middle - far / 2 + tilt, top],
            [middle + far / 2 + tilt, top],
            [middle + near / 2, bottom],
            [middle - near / 2, bottom],
        ],
        np.float32,
    )
    # As much of the belt's length as keeps bodies from being drawn out too much.
    length = min(h, w * rng.uniform(0.9, 1.7) * HEIGHT / max(float(0.5 * (near + far)), 1.0))
    source = np.array([[0, h - length], [w, h - length], [w, h], [0, h]], np.float32)
    return np.asarray(cv2.getPerspectiveTransform(source, corners), np.float64)


def _limit_by_row(view: NDArray[np.float64], limit: float) -> NDArray[np.float32]:
    """The side of a square of `limit` belt pixels in the middle of each row."""
    back = np.linalg.inv(view)
    rows = np.arange(HEIGHT) + 0.5
    at = back @ np.vstack([np.full(HEIGHT, WIDTH / 2.0), rows, np.ones(HEIGHT)])
    x, y, s = at
    x, y = x / s, y / s
    sides = []
    for dx, dy in ((limit / 2, 0.0), (0.0, limit / 2)):
        one = view @ np.vstack([x - dx, y - dy, np.ones(HEIGHT)])
        two = view @ np.vstack([x + dx, y + dy, np.ones(HEIGHT)])
        sides.append(np.hypot(*(one[:2] / one[2] - two[:2] / two[2])))
    return np.sqrt(sides[0] * sides[1]).astype(np.float32)


def _smooth(size: tuple[int, int], cells: tuple[int, int], rng: np.random.Generator) -> Plane:
    return np.asarray(
        cv2.resize(rng.random(cells).astype(np.float32), size, interpolation=cv2.INTER_CUBIC), np.float32
    )


def _structure(size: tuple[int, int], rng: np.random.Generator) -> Plane:
    """What stands around a belt: plates, beams, darkness."""
    w, h = size
    wall = np.full((h, w), rng.uniform(15, 170), np.float32)
    wall += rng.uniform(0, 60) * (_smooth(size, (5, 7), rng) - 0.5)
    for _ in range(int(rng.integers(0, 12))):
        x, y = int(rng.integers(-40, w)), int(rng.integers(-40, h))
        side_w, side_h = int(np.exp(rng.uniform(1.5, 5.5))), int(np.exp(rng.uniform(1.5, 5.5)))
        cv2.rectangle(wall, (x, y), (x + side_w, y + side_h), float(rng.uniform(5, 220)), -1)
    for _ in range(int(rng.integers(0, 6))):
        ends = rng.integers(-40, (w + 40, h + 40), size=(2, 2))
        cv2.line(
            wall, ends[0].tolist(), ends[1].tolist(), float(rng.uniform(5, 230)), int(rng.integers(2, 18))
        )
    return wall


def _light(picture: Plane, rng: np.random.Generator, severity: float = 1.0) -> Plane:
    h, w = picture.shape
    if rng.random() < 0.7:
        picture = picture * (1.0 + severity * rng.uniform(0.0, 0.8) * (_smooth((w, h), (3, 4), rng) - 0.5))
    if rng.random() < 0.25 * severity:  # shadows of a structure, sharp or soft
        shade = np.ones((h, w), np.float32)
        for _ in range(int(rng.integers(1, 4))):
            angle, middle, half = rng.uniform(0, np.pi), rng.uniform(-0.4, 0.4) * w, rng.uniform(8, 90)
            yy, xx = np.indices((h, w), dtype=np.float32)
            along = np.abs((xx - w / 2) * np.cos(angle) + (yy - h / 2) * np.sin(angle) - middle)
            edge = 1.0 / (1.0 + np.exp(np.clip((along - half) / rng.uniform(1.0, 14.0), -30, 30)))
            shade *= 1.0 - rng.uniform(0.2, 0.7) * edge
        picture = picture * shade
    if rng.random() < 0.12 * severity:  # patches of sun
        patch = np.clip((_smooth((w, h), (4, 6), rng) - 0.6) * rng.uniform(4, 30), 0, 1)
        picture = picture * (1.0 + rng.uniform(0.3, 1.0) * patch)
    if rng.random() < 0.2 * severity:  # wet: darker, more contrast
        wet = np.clip((_smooth((w, h), (3, 5), rng) - 0.4) * rng.uniform(3, 12), 0, 1)
        picture = picture * (1.0 - rng.uniform(0.2, 0.5) * wet)
    if rng.random() < 0.12 * severity:  # a lamp at night
        yy, xx = np.indices((h, w), dtype=np.float32)
        cx, cy = rng.uniform(0.2, 0.8) * w, rng.uniform(0.2, 0.8) * h
        far = ((xx - cx) / (rng.uniform(0.3, 0.8) * w)) ** 2 + ((yy - cy) / (rng.uniform(0.3, 0.8) * h)) ** 2
        picture = picture * (0.15 + rng.uniform(0.7, 1.6) * np.exp(-far))
    if rng.random() < 0.3 * severity:  # another tone curve
        level = np.clip(picture, 0, 255) / 255.0
        picture = 255.0 * level ** float(np.exp(rng.normal(0.0, 0.35)))
    if rng.random() < 0.06 * severity:
        picture = rng.uniform(180, 255) - rng.uniform(0.5, 0.9) * picture
    gain = float(np.exp(rng.normal(-0.1, 0.3 * severity)))
    if rng.random() < 0.06 * severity:
        gain *= rng.uniform(1.3, 2.2)  # overexposed
    return np.clip(picture * gain + rng.uniform(-15, 20), 0, 255).astype(np.float32)


def _weather(picture: Plane, rng: np.random.Generator, severity: float = 1.0) -> Plane:
    h, w = picture.shape
    if rng.random() < 0.4 * severity:  # dust or steam
        veil = np.clip(_smooth((w, h), (int(rng.integers(2, 6)), int(rng.integers(3, 8))), rng), 0, 1)
        veil *= rng.uniform(0.1, 0.75)
        picture = picture * (1.0 - veil) + rng.uniform(110, 230) * veil
    if rng.random() < 0.1 * severity:  # low contrast everywhere
        picture = picture.mean() + rng.uniform(0.25, 0.6) * (picture - picture.mean())
    if rng.random() < 0.08 * severity:  # rain
        drops = np.zeros((h, w), np.float32)
        slant = rng.uniform(-0.3, 0.3)
        for _ in range(int(rng.integers(40, 400))):
            x, y, length = rng.uniform(0, w), rng.uniform(0, h), rng.uniform(8, 40)
            cv2.line(
                drops,
                (int(x), int(y)),
                (int(x + slant * length), int(y + length)),
                float(rng.uniform(0.1, 0.5)),
                1,
            )
        picture = picture + 90.0 * cv2.GaussianBlur(drops, (0, 0), 0.8)
    if rng.random() < 0.08 * severity:  # snow
        flakes: Plane = np.zeros((h, w), np.float32)
        for _ in range(int(rng.integers(40, 400))):
            centre = int(rng.uniform(0, w)), int(rng.uniform(0, h))
            cv2.circle(flakes, centre, int(rng.integers(1, 5)), float(rng.uniform(0.3, 1.0)), -1)
        flakes = cv2.GaussianBlur(flakes, (0, 0), rng.uniform(0.6, 2.0))
        picture = picture + flakes * (235.0 - picture)
    if rng.random() < 0.05 * severity:  # drops on the lens
        blurred = cv2.GaussianBlur(picture, (0, 0), 7.0)
        wet: Plane = np.zeros((h, w), np.float32)
        for _ in range(int(rng.integers(1, 6))):
            cv2.circle(
                wet, (int(rng.uniform(0, w)), int(rng.uniform(0, h))), int(rng.integers(10, 55)), 1.0, -1
            )
        soft = cv2.GaussianBlur(wet, (0, 0), 4.0)
        picture = picture + soft * (1.05 * blurred - picture)
    return picture.astype(np.float32)


def _sensor(picture: Plane, rng: np.random.Generator, severity: float = 1.0) -> Bytes:
    h, w = picture.shape
    if rng.random() < 0.5:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 0.8 + 1.4 * severity))
    if rng.random() < 0.15 * severity:
        n = int(rng.integers(3, 13))
        kernel = np.zeros((n, n), np.float32)
        kernel[:, n // 2] = 1.0 / n
        picture = cv2.filter2D(picture, -1, kernel)
    if rng.random() < 0.15:
        picture = picture + rng.uniform(0.3, 1.5) * (picture - cv2.GaussianBlur(picture, (0, 0), 2.0))
    noise: Plane = rng.standard_normal((h, w), dtype=np.float32)
    if rng.random() < 0.3:
        noise = 1.8 * cv2.GaussianBlur(noise, (0, 0), rng.uniform(0.6, 1.4))
    level = (
        float(np.exp(rng.uniform(np.log(0.5), np.log(9.0))))
        if rng.random() < 1.0 - 0.1 * severity
        else rng.uniform(9.0, 26.0)
    )
    picture = picture + level * noise
    out: Bytes = np.clip(picture, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        quality = int(rng.integers(8, 70))
        if rng.random() < 0.3 * severity:  # as a small stream scaled up
            small = cv2.resize(out, (w // 2, h // 2), interpolation=cv2.INTER_AREA)
            out = _coded(small, quality)
            return np.asarray(cv2.resize(out, (w, h), interpolation=cv2.INTER_LINEAR), np.uint8)
        out = _coded(out, quality)
    return np.asarray(out, np.uint8)


def _coded(picture: Bytes, quality: int) -> Bytes:
    """What is left of a picture after JPEG."""
    content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_GRAYSCALE), np.uint8)
