"""Scenes of the experiments: pictures, true boxes and the motion model of each step.

Every scene shows some empty frames of the same noise before the object comes and after it has gone.
The same seed gives the same pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

EMPTY = (30, 30)
"""Frames without the object, before and after it."""
WHOLE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Scene:
    """A short sequence with one object."""

    pictures: tuple[Image, ...]
    """Gray (h, w) or BGR (h, w, 3)."""
    boxes: NDArray[np.float64]
    """Centre x, y, width and height in each frame (n, 4); not a number where no object is there."""
    labels: NDArray[np.intp]
    """Index of the motion model that led to each frame (n,); -1 where it is not known."""
    interval_s: float
    polygon: tuple[tuple[float, float], ...] = WHOLE

    @property
    def present(self) -> NDArray[np.bool_]:
        """Whether the object is there, per frame (n,)."""
        return ~np.isnan(self.boxes[:, 0])


def with_empty(
    path: Sequence[tuple[float, float]],
    labels: Sequence[int],
    size: tuple[float, float],
    empty: tuple[int, int],
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Boxes and labels of a path, with empty frames before and after it."""
    n = len(path)
    boxes = np.full((empty[0] + n + empty[1], 4), np.nan)
    boxes[empty[0] : empty[0] + n, :2] = path
    boxes[empty[0] : empty[0] + n, 2:] = size
    known = np.full(len(boxes), -1, dtype=np.intp)
    known[empty[0] : empty[0] + n] = labels
    return boxes, known


def cloudy(
    rng: np.random.Generator, shape: tuple[int, int], blur: float, spread: float
) -> NDArray[np.float64]:
    """Smooth random texture of mean 0 and standard deviation `spread`."""
    texture = np.asarray(cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), blur), dtype=np.float64)
    return np.asarray((texture - texture.mean()) * (spread / texture.std()))


def noisy(picture: NDArray[np.float64], noise: float, rng: np.random.Generator) -> Image:
    """The picture as a camera of this noise (grey levels) shows it."""
    return np.clip(np.round(picture + noise * rng.standard_normal(picture.shape)), 0, 255).astype(np.uint8)


def paste(
    picture: NDArray[np.float64], patch: NDArray[np.float64], alpha: NDArray[np.float64], x: float, y: float
) -> None:
    """Blend a patch into the picture (in place) with its centre at (x, y), at a fraction of a pixel."""
    h, w = alpha.shape
    shift = np.array([[1.0, 0.0, x - 0.5 * w], [0.0, 1.0, y - 0.5 * h]])
    size = (picture.shape[1], picture.shape[0])
    mask = np.asarray(cv2.warpAffine(alpha, shift, size))
    moved = np.asarray(cv2.warpAffine(patch * (alpha if patch.ndim == 2 else alpha[..., None]), shift, size))
    keep = 1.0 - (mask if picture.ndim == 2 else mask[..., None])
    picture *= keep
    picture += moved


SQUARE_SHAPE, SQUARE_SIZE, SQUARE_STEPS = (120, 160), 20, 10


def bouncing_square(seed: int, noise: float, frames: int = 100, empty: tuple[int, int] = EMPTY) -> Scene:
    """A textured square crosses the picture in ten frames, bounces, and crosses again.

    Its velocity is the crossing speed plus white noise along both axes; it bounces on the frame at
    which it would leave.
    """
    rng = np.random.default_rng([seed, 1])
    h, w = SQUARE_SHAPE
    margin = 0.5 * SQUARE_SIZE
    speed = (w - SQUARE_SIZE) / SQUARE_STEPS
    x, y, sign = margin + rng.uniform(0.0, w - 2 * margin), rng.uniform(0.3, 0.7) * h, rng.choice([-1.0, 1.0])
    path, labels = [(x, y)], [0]
    for _ in range(frames - 1):
        bounces = not margin <= x + sign * speed <= w - margin
        sign = -sign if bounces else sign
        x = float(np.clip(x + sign * speed + rng.standard_normal(), margin, w - margin))
        y = float(np.clip(y + 0.7 * rng.standard_normal(), margin, h - margin))
        path.append((x, y))
        labels.append(int(bounces))
    boxes, known = with_empty(path, labels, (SQUARE_SIZE, SQUARE_SIZE), empty)
    backdrop = 120.0 + cloudy(rng, SQUARE_SHAPE, 2.0, 10.0)
    pattern = np.kron(np.array([[1, -1, 1, -1], [-1, 1, -1, 1]] * 2, dtype=float), np.ones((5, 5)))
    square = 120.0 + 40.0 * pattern
    return _filmed(backdrop, boxes, known, square, np.ones_like(square), noise, 0.1, rng)


TABLE_SHAPE, TABLE_ROW, TABLE_ENDS, BATS = (180, 320), 132.0, (60.0, 260.0), (36.0, 284.0)
BALL_SIZE, TABLE_INTERVAL_S, PX_PER_M = 8, 1 / 25, 73.0
GRAVITY_M_S2 = 9.81


def table_tennis(seed: int, noise: float, frames: int = 200, empty: tuple[int, int] = EMPTY) -> Scene:
    """A rally seen from the side: flight under gravity, a bounce on the table, a return by the bat.

    The ball moves continuously, so that a bounce falls between two frames; the step over it has the
    label of the bounce. The ball is drawn some three times its true size.
    """
    rng = np.random.default_rng([seed, 2])
    path, labels = _rally(rng, frames)
    boxes, known = with_empty(path, labels, (BALL_SIZE, BALL_SIZE), empty)
    w = TABLE_SHAPE[1]
    backdrop = 105.0 + cloudy(rng, TABLE_SHAPE, 2.5, 12.0)
    backdrop[int(TABLE_ROW) + 5 : int(TABLE_ROW) + 12, int(TABLE_ENDS[0]) : int(TABLE_ENDS[1])] -= 45.0
    backdrop[int(TABLE_ROW) - 6 : int(TABLE_ROW) + 5, w // 2 - 1 : w // 2 + 2] -= 30.0
    for bat in BATS:
        backdrop[
            70:, int(bat - 28 if bat < w / 2 else bat + 8) : int(bat - 8 if bat < w / 2 else bat + 28)
        ] -= 35.0
    disc = np.zeros((BALL_SIZE, BALL_SIZE))
    cv2.ellipse(disc, (BALL_SIZE // 2, BALL_SIZE // 2), (BALL_SIZE // 2, BALL_SIZE // 2), 0, 0, 360, 1.0, -1)
    return _filmed(backdrop, boxes, known, np.full(disc.shape, 195.0), disc, noise, TABLE_INTERVAL_S, rng)


def _rally(rng: np.random.Generator, frames: int) -> tuple[list[tuple[float, float]], list[int]]:
    """Positions and labels (0 flight, 1 table, 2 bat) of a rally."""
    gravity, dt, fine = GRAVITY_M_S2 * PX_PER_M, TABLE_INTERVAL_S, 20
    x, y, side = BATS[0], TABLE_ROW - rng.uniform(20.0, 40.0), 1
    vx, vy = _return(rng, x, y, side, gravity)
    path, labels = [(x, y)], [0]
    for _ in range(frames - 1):
        label = 0
        for _ in range(fine):
            vy += gravity * dt / fine
            x, y = x + vx * dt / fine, y + vy * dt / fine
            if y > TABLE_ROW and vy > 0.0 and TABLE_ENDS[0] <= x <= TABLE_ENDS[1]:
                y, vy, label = TABLE_ROW, -0.85 * vy, 1
            elif side * (x - BATS[side > 0]) > 0.0:
                side, label = -side, 2
                vx, vy = _return(rng, x, y, side, gravity)
        path.append((x, y))
        labels.append(label)
    return path, labels


def _return(rng: np.random.Generator, x: float, y: float, side: int, gravity: float) -> tuple[float, float]:
    """Velocity off the bat that lands the ball on the far part of the table."""
    speed = rng.uniform(270.0, 330.0)
    target = 0.5 * sum(TABLE_ENDS) + side * rng.uniform(45.0, 75.0)
    time = abs(target - x) / speed
    return side * speed, (TABLE_ROW - y) / time - 0.5 * gravity * time


def _filmed(
    backdrop: NDArray[np.float64],
    boxes: NDArray[np.float64],
    labels: NDArray[np.intp],
    patch: NDArray[np.float64],
    alpha: NDArray[np.float64],
    noise: float,
    interval_s: float,
    rng: np.random.Generator,
) -> Scene:
    pictures = []
    for box in boxes:
        picture = backdrop.copy()
        if not np.isnan(box[0]):
            paste(picture, patch, alpha, box[0], box[1])
        pictures.append(noisy(picture, noise, rng))
    return Scene(tuple(pictures), boxes, labels, interval_s)


JUGGLING_SHAPE, FOOT_ROW, FOOTBALL = (160, 220), 130.0, 18


def juggling(seed: int, noise: float, frames: int = 125, empty: tuple[int, int] = EMPTY) -> Scene:
    """A football falls with constant acceleration and is kicked up again before it lands."""
    rng = np.random.default_rng([seed, 3])
    gravity = 1.4  # px/frame^2
    x, y, vx, vy = 110.0, 50.0, 0.0, 0.0
    path, labels = [(x, y)], [0]
    for _ in range(frames - 1):
        kicked = y + vy > FOOT_ROW + rng.normal(0.0, 2.0)
        if kicked:
            vx, vy = (
                rng.normal((110.0 - x) / 15.0, 0.6),
                -float(np.clip(vy * rng.normal(0.97, 0.08), 8.0, 13.0)),
            )
        else:
            vy += gravity
        x, y = x + vx, y + vy
        path.append((float(x + rng.normal(0.0, 0.3)), float(y + rng.normal(0.0, 0.3))))
        labels.append(int(kicked))
    boxes, known = with_empty(path, labels, (FOOTBALL, FOOTBALL), empty)
    backdrop = 125.0 + cloudy(rng, JUGGLING_SHAPE, 2.0, 5.0)
    alpha = np.zeros((FOOTBALL, FOOTBALL))
    cv2.circle(alpha, (FOOTBALL // 2, FOOTBALL // 2), FOOTBALL // 2 - 1, 1.0, -1)
    yy, xx = np.mgrid[:FOOTBALL, :FOOTBALL]
    patch = np.where(((xx // 4) + (yy // 4)) % 2 == 0, 175.0, 80.0)
    return _filmed(backdrop, boxes, known, patch, alpha, noise, 1 / 30, rng)


SLIDE_SHAPE, SLIDE_FRAMES, PERSON = (150, 180), 28, (18, 28)


def slide(seed: int, noise: float, empty: tuple[int, int] = EMPTY) -> Scene:
    """A person slides down with constant acceleration and then wanders about at its end."""
    rng = np.random.default_rng([seed, 4])
    x, y, speed = rng.uniform(24.0, 30.0), rng.uniform(24.0, 30.0), rng.uniform(1.0, 2.0)
    slope, rate = np.array([0.78, 0.62]), rng.uniform(0.7, 0.8)
    path, labels = [(x, y)], [0]
    while len(path) < SLIDE_FRAMES:
        slides = y < 100.0 and labels[-1] == 0
        speed += rate
        step = speed * slope + rng.normal(0.0, 0.3, 2) if slides else rng.normal(0.0, 2.0, 2)
        x, y = float(x + step[0]), float(y + step[1])
        path.append((x, y))
        labels.append(0 if slides else 1)
    boxes, known = with_empty(path, labels, PERSON, empty)
    backdrop = 120.0 + cloudy(rng, SLIDE_SHAPE, 2.0, 12.0)
    cv2.line(backdrop, (12, 40), (134, 137), 100.0, 3)
    cv2.line(backdrop, (134, 137), (180, 137), 100.0, 3)
    alpha = np.zeros(PERSON[::-1])
    cv2.ellipse(alpha, (PERSON[0] // 2, PERSON[1] // 2), (PERSON[0] // 2, PERSON[1] // 2), 0, 0, 360, 1.0, -1)
    patch = np.where(np.arange(PERSON[1])[:, None] < 14, 70.0, 170.0) * np.ones(PERSON[::-1])
    return _filmed(backdrop, boxes, known, patch, alpha, noise, 1 / 25, rng)
