"""Where the camera looks, by registration of its surroundings against a reference still.

Phase correlation (Kuglin and Hines 1975; sub-pixel by the centroid of the peak, as in OpenCV) of gradient
pictures: gradients do not change with the light. Where enough structure lies outside the regions of interest
only that is used; moving ore would otherwise pull. One estimate decides nothing: take a median over seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

Field = NDArray[np.float32]

_LEAST_SHARE = 0.2  # of the structure must lie outside the regions for the inside to be left out
_CLIP = 3.0  # gradients count up to this multiple of their mean: no single edge decides
_MARGIN = 5  # the border around regions whose gradients are not used, px
_ROUNDS = 3  # the window does not move with the picture: it pulls towards zero until it is moved back


@dataclass(frozen=True, slots=True)
class Shift:
    """How far the picture has moved against the still, in its pixels, and how sure that is."""

    x: float
    y: float
    response: float
    """Share of the correlation's energy around the peak, 0 to 1."""


class Registration:
    """Registers pictures against one still (h, w); `moving` (h, w) is 1 where things move."""

    def __init__(self, still: Image, moving: Image) -> None:
        height, width = still.shape
        if moving.shape != still.shape:
            raise ValueError(f"a still of {still.shape} and a mask of {moving.shape} do not fit")
        grown = cv2.dilate(moving, np.ones((_MARGIN, _MARGIN), np.uint8))
        outside = cv2.GaussianBlur((grown == 0).astype(np.float32), (0, 0), 2.0)
        gradient = _gradient(still)
        total = float(gradient.sum())
        share = float((gradient * outside).sum()) / total if total > 0 else 0.0
        hann = cv2.createHanningWindow((width, height), cv2.CV_32F)
        # A Hann window would leave little of surroundings at the border: its square root keeps more.
        window = np.sqrt(np.clip(np.asarray(hann, np.float32), 0, None))
        self._window: Field = window * outside if share >= _LEAST_SHARE else window
        self._still = self._prepared(gradient)

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width of the still."""
        return self._still.shape

    def shift(self, picture: Image) -> Shift:
        """The shift of a picture (h, w); raises ValueError for another size."""
        if picture.shape != self._still.shape:
            raise ValueError(f"a picture of {picture.shape} cannot be registered on {self._still.shape}")
        gradient = _gradient(picture)
        height, width = picture.shape
        x = y = response = 0.0
        for _ in range(_ROUNDS):
            back = np.array([[1, 0, -x], [0, 1, -y]])
            moved = cv2.warpAffine(gradient, back, (width, height), borderMode=cv2.BORDER_REPLICATE)
            (dx, dy), response = cv2.phaseCorrelate(
                self._still, self._prepared(np.asarray(moved, np.float32))
            )
            x, y = x + dx, y + dy
            if max(abs(dx), abs(dy)) < 0.02:
                break
            if max(abs(x) / width, abs(y) / height) > 0.5:
                return Shift(float(x), float(y), 0.0)  # nothing of the still would be left
        return Shift(float(x), float(y), float(response))

    def _prepared(self, gradient: Field) -> Field:
        mean = float((gradient * self._window).sum()) / float(self._window.sum())
        return np.asarray((gradient - mean) * self._window, np.float32)


def _gradient(picture: Image) -> Field:
    """Strength of the gradient (h, w)."""
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8)
    x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    strength = np.asarray(cv2.magnitude(x, y), np.float32)
    return np.asarray(np.minimum(strength, _CLIP * float(strength.mean()) + 1e-6), np.float32)
