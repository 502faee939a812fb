"""Faults of a camera, laid over pictures of 640 x 480 that are fit."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image
from lumpwatch.service.simulator.codec import ThinLink
from lumpwatch.service.simulator.spec import FeedSpec

Fault = Callable[[Image, int], Image]
"""Picture and its number -> what the faulty camera gives."""
_WIDTH, _HEIGHT = 640, 480


def _field(image: NDArray[np.floating]) -> Image:
    return np.clip(image, 0, 255).astype(np.uint8)


def _noise(k: int) -> NDArray[np.float64]:
    return np.random.default_rng(k % 16).normal(0.0, 2.5, (_HEIGHT, _WIDTH))


def blurred(sigma: float) -> Fault:
    """Out of focus."""
    return lambda picture, k: np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)


def dusty(veil: float) -> Fault:
    """A bright, slightly cloudy veil of that opacity."""
    cloud = cv2.GaussianBlur(np.random.default_rng(0).standard_normal((_HEIGHT, _WIDTH)), (0, 0), 60)
    share = np.clip(veil + 0.05 * cloud / cloud.std(), 0.0, 1.0)
    return lambda picture, k: _field(picture * (1 - share) + 150 * share + _noise(k) * share)


def dark(factor: float) -> Fault:
    """The light goes, the sensor's noise stays."""
    return lambda picture, k: _field(picture * factor + _noise(k))


def glare() -> Fault:
    """The sun on the lens."""
    y, x = np.mgrid[:_HEIGHT, :_WIDTH]
    light = 420 * np.exp(-(((x - 320) / 220) ** 2 + ((y - 250) / 200) ** 2))
    return lambda picture, k: _field(picture + light)


def hidden() -> Fault:
    """A plate before most of the belt."""

    def cover(picture: Image, k: int) -> Image:
        covered = picture.copy()
        covered[:, 160:600] = _field(90 + _noise(k)[:, 160:600])
        return covered

    return cover


def dirty() -> Fault:
    """Dark splashes on the lens over some half of the belt."""
    rng, spots = np.random.default_rng(4), np.zeros((_HEIGHT, _WIDTH), np.float32)
    for _ in range(20):
        centre = int(rng.integers(120, 520)), int(rng.integers(40, 440))
        cv2.circle(spots, centre, int(rng.integers(50, 90)), 1.0, -1)
    share = 0.95 * cv2.GaussianBlur(spots, (0, 0), 12)
    return lambda picture, k: _field(picture * (1 - share) + 0.4 * cv2.blur(picture, (61, 61)) * share)


def knocked(x: float, y: float) -> Fault:
    """The camera is turned: the picture moves."""
    matrix = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    size = _WIDTH, _HEIGHT
    return lambda picture, k: np.asarray(
        cv2.warpAffine(picture, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def clock(picture: Image, k: int, fps: float) -> Image:
    """The picture with the time burnt in, over the region of interest."""
    stamped = picture.copy()
    stamped[4:24, 230:350] = 16
    cv2.putText(stamped, f"12:{int(k / fps):05d}", (234, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 235, 1)
    return stamped


def frozen(fps: float, *, stamped: bool = False, crf: int | None = None) -> Fault:
    """The first picture for ever, where asked for with a running clock, or coded again all the time."""
    held: list[Image] = []
    link = None if crf is None else ThinLink(FeedSpec(h264_crf=crf, fps=fps))

    def freeze(picture: Image, k: int) -> Image:
        if not held:
            held.append(picture.copy())
        shown = clock(held[0], k, fps) if stamped else held[0]
        return shown if link is None else np.asarray(link.through(shown, k), np.uint8)

    return freeze
