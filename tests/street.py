"""A still street with boxes that move over it, for the trackers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.core.video_writer import VideoWriter

WIDTH, HEIGHT, FPS = 320, 240, 15.0
EMPTY_S = 3.0
SIDE = 36
SPEED = 75.0
"""px/s."""
Lane = tuple[int, float, tuple[int, int, int]]
LANES: tuple[Lane, ...] = ((90, 1.0, (40, 60, 210)), (170, -1.0, (200, 140, 30)))
"""Row, direction along x and colour of each lane's box; the second goes the wrong way."""


def pictures(
    seconds: float, seed: int = 1, lanes: tuple[Lane, ...] = LANES, side: int = SIDE
) -> Iterator[NDArray[np.uint8]]:
    """BGR pictures: three empty seconds, then one box in each lane, again and again."""
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.uniform(60, 160, (HEIGHT, WIDTH, 3)), (0, 0), 3)
    ground = (ground - ground.mean()) * 6 + 110
    texture = rng.uniform(0.75, 1.0, (side, side, 1))
    crossing_s = (WIDTH + side) / SPEED
    for i in range(round(seconds * FPS)):
        shown = ground.copy()
        since = i / FPS - EMPTY_S
        if since >= 0:
            way = since % crossing_s * SPEED
            for row, direction, colour in lanes:
                left = way - side if direction > 0 else WIDTH - way
                low, high = max(round(left), 0), min(round(left) + side, WIDTH)
                if high > low:
                    part = texture[:, low - round(left) : high - round(left)] * np.array(colour, float)
                    shown[row - side // 2 : row - side // 2 + side, low:high] = part
        shown += rng.normal(0.0, 3.0, shown.shape)
        yield np.clip(shown, 0, 255).astype(np.uint8)


def labels(seconds: float, lanes: tuple[Lane, ...] = LANES, side: int = SIDE) -> str:
    """MOTChallenge text of the boxes, with a new id for every crossing; of those that enter or leave to be ignored."""
    crossing_s = (WIDTH + side) / SPEED
    lines = []
    for i in range(round(seconds * FPS)):
        since = i / FPS - EMPTY_S
        if since < 0:
            continue
        crossing, way = int(since // crossing_s), since % crossing_s * SPEED
        for lane, (row, direction, _) in enumerate(lanes):
            left = round(way - side if direction > 0 else WIDTH - way)
            low, high = max(left, 0), min(left + side, WIDTH)
            if high > low:
                whole = int(high - low == side)
                who = len(lanes) * crossing + lane + 1
                lines.append(f"{i + 1},{who},{low},{row - side // 2},{high - low},{side},{whole},1,1")
    return "\n".join(lines) + "\n"


def write(path: Path, seconds: float) -> Path:
    """The street as a video file."""
    with VideoWriter(path, WIDTH, HEIGHT, FPS, crf=16) as video:
        for picture in pictures(seconds):
            video.write(picture)
    return path
