"""What moves before a still camera: the foreground mask, and its blobs.

A background model satisfies `Foreground`. The one here is OpenCV's mixture of Gaussians for each
pixel (Zivkovic 2004; MOG2) with its shadows taken out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.roi import Image

Boxes = NDArray[np.float64]
"""Centre x, centre y, width and height (n, 4)."""


class Foreground(Protocol):
    """A background model: it learns from each picture and says what does not belong to the scene."""

    def apply(self, picture: Image, learn: bool = True) -> Image:
        """The mask (h, w), 0 or 255, of a BGR picture (h, w, 3), from which the model learns where it may."""


@dataclass(frozen=True, slots=True)
class MixtureOptions:
    """Parameters of `MixtureForeground`."""

    memory: int = 500
    """Pictures over which the background is learned; what stands for about a tenth of it becomes background."""
    threshold: float = 30.0
    """Squared Mahalanobis distance from which a pixel is no longer background."""
    warm_up: int = 15
    """First pictures, from which the background is learned as their mean: whoever stood there leaves no ghost."""
    blur: float = 1.0
    """Standard deviation of the smoothing against the noise of compression, px; 0 for none."""

    def __post_init__(self) -> None:
        """Raises ValueError for numbers that cannot be meant."""
        if self.memory < 1 or self.warm_up < 0 or self.blur < 0.0 or not self.threshold > 0.0:
            raise ValueError(
                "a background model needs a memory of a picture or more and a positive threshold"
            )


class MixtureForeground:
    """OpenCV's MOG2; pixels that it takes for shadow count as background."""

    def __init__(self, options: MixtureOptions | None = None) -> None:
        self._options = options or MixtureOptions()
        self._model = cv2.createBackgroundSubtractorMOG2(self._options.memory, self._options.threshold, True)
        self._shape: tuple[int, ...] = ()
        self._seen = 0

    def apply(self, picture: Image, learn: bool = True) -> Image:
        """The mask of a picture; without `learn` only the very first one teaches anything.

        Raises ValueError for a shape that is not (h, w, 3) or not the first one's.
        """
        shape = self._shape or picture.shape
        if len(shape) != 3 or shape[2] != 3 or picture.shape != shape:
            raise ValueError(f"a picture of shape {picture.shape}, expected {self._shape or '(h, w, 3)'}")
        self._shape = shape
        o = self._options
        rate = 0.0
        if learn:
            self._seen = min(self._seen + 1, o.warm_up + 1)
            rate = 1.0 / (2 * self._seen) if self._seen <= o.warm_up else 1.0 / o.memory
        smooth = cv2.GaussianBlur(picture, (0, 0), o.blur) if o.blur > 0.0 else picture
        found = self._model.apply(smooth, learningRate=rate)
        return np.where(found == 255, np.uint8(255), np.uint8(0))


def cleaned(mask: Image, opening: int = 3, closing: tuple[int, int] = (3, 7)) -> Image:
    """The mask without specks thinner than `opening` pixels, with gaps below `closing` (w, h) filled.

    People are taller than wide, so are the gaps in them.
    """
    if opening > 1:
        square = np.ones((opening, opening), np.uint8)
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, square), dtype=np.uint8)
    if max(closing) > 1:
        upright = np.ones((closing[1], closing[0]), np.uint8)
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, upright), dtype=np.uint8)
    return mask


def blobs(mask: Image, least_area: int, opening: int = 3, closing: tuple[int, int] = (3, 7)) -> Boxes:
    """The `regions` of the cleaned mask."""
    return regions(cleaned(mask, opening, closing), least_area)


def regions(mask: Image, least_area: int) -> Boxes:
    """Boxes (n, 4) of the connected regions of at least `least_area` pixels in a mask (h, w), 0 or not.

    Raises ValueError where the mask has another number of axes.
    """
    if mask.ndim != 2:
        raise ValueError(f"a mask has two axes, not {mask.ndim}")
    rows, columns = mask.shape
    # Short labels are three times faster; no more than one region starts in a square of four pixels.
    few = ((rows + 1) // 2) * ((columns + 1) // 2) < 2**16 - 1
    _, _, stats, _ = cv2.connectedComponentsWithStats(
        mask, connectivity=8, ltype=cv2.CV_16U if few else cv2.CV_32S
    )
    rest = stats[1:]  # the first is the background
    kept = rest[rest[:, cv2.CC_STAT_AREA] >= least_area].astype(np.float64)
    return np.column_stack([kept[:, :2] + kept[:, 2:4] / 2, kept[:, 2:4]])
