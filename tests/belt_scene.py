"""A small live camera drawn by hand: stones that run, surroundings that stay, noise; and faults of its picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from lumpwatch.models.roi import Image
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.storage.reference_store import Reference
from lumpwatch.service.training.picture_reference import Recording, learn_reference
from tests.service_helpers import site, site_tree

Fault = Callable[[Image, int], Image]
"""A picture and its number -> what the faulty camera shows."""
WIDTH, HEIGHT = 192, 128
FPS = 5.0
WHEN = datetime(2024, 5, 17, 12, 30, tzinfo=UTC)


def camera(**quality: Any) -> CameraConfig:
    tree = site_tree(particles=50)
    tree["cameras"][0]["quality"] = quality
    return site(tree).cameras[0]


def every_frame(config: CameraConfig) -> CameraConfig:
    """The same, decided on every frame."""
    rois = tuple(roi.model_copy(update={"decide_hz": "all"}) for roi in config.rois)
    return config.model_copy(update={"rois": rois})


def blocks(seed: int, shape: tuple[int, int]) -> Image:
    """Stones of all greys."""
    rng = np.random.default_rng(seed)
    picture = np.full(shape, 90, np.uint8)
    for _ in range(shape[0] * shape[1] // 60):
        corner = rng.integers(-4, (shape[1], shape[0]))
        opposite = corner + rng.integers(2, 9, 2)
        cv2.rectangle(picture, corner.tolist(), opposite.tolist(), int(rng.integers(40, 200)), -1)
    return picture


STILL = blocks(1, (HEIGHT, WIDTH))
ORE = blocks(2, (4096, 144))


@lru_cache(maxsize=1000)
def belt(k: int, *, noise: int | None = None, run: bool = True) -> Image:
    """Picture k of a live camera: surroundings that stay, ore that runs within the ROI, noise. To be read alone."""
    picture = STILL.copy()
    row = 5 * k % 3900 if run else 0
    picture[16:112, 24:168] = ORE[row : row + 96]
    grain = np.random.default_rng(k if noise is None else noise).normal(0.0, 2.0, picture.shape)
    seen = np.clip(np.round(picture + grain), 0, 255).astype(np.uint8)
    seen.setflags(write=False)
    return seen


def frames(shown: Iterator[Image], start: int = 0) -> Iterator[Frame]:
    for k, data in enumerate(shown, start):
        yield Frame(k, k / FPS, k / FPS, 1.7e9, WIDTH, HEIGHT, "gray8", data)


def learned(config: CameraConfig, count: int = 150) -> Reference:
    recording = Recording("day.mp4", frames(belt(k) for k in range(count)))
    return learn_reference(config, {"day": [recording]}, 1e-3, WHEN).reference


CONFIG = camera()
REFERENCE = learned(CONFIG)


def blurred(picture: Image, k: int) -> Image:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 2.5), np.uint8)


def dusty(picture: Image, k: int) -> Image:
    return np.clip(0.12 * picture + 0.88 * 170, 0, 255).astype(np.uint8)


def dark(picture: Image, k: int) -> Image:
    return (picture // 16).astype(np.uint8)


def white(picture: Image, k: int) -> Image:
    return np.full_like(picture, 255)


def plate(picture: Image, k: int) -> Image:
    covered = picture.copy()
    covered[:, 40:] = np.clip(picture[:, 40:] // 40 + 85, 0, 255)
    return covered


def frozen(picture: Image, k: int) -> Image:
    held = belt(249).copy()
    cv2.putText(held, f"{k // 5:04d}", (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 255, 1)
    return held


def turned(picture: Image, k: int) -> Image:
    return np.roll(picture, (9, 14), (0, 1))
