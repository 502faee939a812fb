"""Likelihood from a network of the user's own: a map of logits over the working picture.

The network looks at the grey working picture once a frame and gives a map of any stride, positive
where it sees a lump. The log likelihood ratio of a box is

    mean of the map in the box - max(threshold, mean of the map in the ring around it),

so that the box that holds the lump, the whole lump and nothing but the lump, scores best. Both means
come from one integral image of the map, so a box costs the same whatever its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.likelihood.base import LEAST_INSIDE, bounded, box_edges, box_inside, box_sum
from lumpwatch.models.roi import Image, View
from lumpwatch.models.state import States

ScoreMap = Callable[[Image], NDArray[np.float32]]
"""Grey picture (h, w) -> logits (any height, any width) that cover it."""

_RING = 1.5
_LARGEST = 1e6
"""OpenCV turns what is not a number into the largest float in some layers; no logit comes near."""


class NetworkError(ValueError):
    """A network cannot be used; the text says why, without naming the file."""


class OnnxScoreMap:
    """A `ScoreMap` by OpenCV's dnn module.

    The picture goes in as (1, channels, height, width), grey levels times `scale`; the output has to
    be a map (1, 1, h, w), or the same without one or both of the leading ones.
    """

    def __init__(
        self, content: bytes, size: tuple[int, int] | None = None, channels: int = 1, scale: float = 1 / 255
    ) -> None:
        """`content`: bytes of an ONNX file; `size`: width and height that it wants, None: any.

        Raises NetworkError.
        """
        try:
            self._net: Any = cv2.dnn.readNetFromONNX(np.frombuffer(content, np.uint8))
        except cv2.error as error:
            raise NetworkError(f"is not an ONNX network that OpenCV can read ({_short(error)})") from error
        self._size, self._channels, self._scale = size, channels, scale

    def __call__(self, gray: Image) -> NDArray[np.float32]:
        """The map of a picture (h, w). Raises NetworkError."""
        size = self._size or (gray.shape[1], gray.shape[0])
        blob = cv2.dnn.blobFromImage(gray, self._scale, size)
        try:
            self._net.setInput(np.repeat(blob, self._channels, axis=1))
            out = np.asarray(self._net.forward())
        except cv2.error as error:
            raise NetworkError(f"fails on a picture of {size[0]} x {size[1]} ({_short(error)})") from error
        shape = out.shape
        if len(shape) > 2 and all(side == 1 for side in shape[:-2]):
            out = out.reshape(shape[-2:])
        if out.ndim != 2 or min(out.shape) < 2 or out.shape[0] > size[1] or out.shape[1] > size[0]:
            raise NetworkError(
                f"gives an output of shape {tuple(shape)} where a map of logits (1, 1, height, width) "
                f"is expected, at most {size[1]} by {size[0]}"
            )
        return out


def _short(error: cv2.error) -> str:
    """What OpenCV says, without its file and line."""
    return str(getattr(error, "err", "") or error).strip().splitlines()[0]


@dataclass(frozen=True, slots=True)
class NetworkLikelihood:
    """Boxes on the map of a network, tempered and bounded."""

    net: ScoreMap
    threshold: float
    """Logit that the mean of a box must exceed to speak for a lump."""
    evidence: float
    bound: float

    def observe(self, view: View, dt: float = inf) -> NetworkObservation:
        """Run the network on the picture. Raises NetworkError."""
        height, width = view.gray.shape
        logits = np.asarray(self.net(view.gray), dtype=np.float32)
        if logits.ndim != 2 or logits.size == 0:
            raise NetworkError(
                f"gives an output of shape {logits.shape} where a map of logits (h, w) is expected"
            )
        if not (np.abs(logits) < _LARGEST).all():
            raise NetworkError(f"gives numbers that are no logits (not finite, or beyond {_LARGEST:g})")
        covering = cv2.resize(logits, (width, height), interpolation=cv2.INTER_LINEAR)
        integral = np.asarray(cv2.integral(covering, sdepth=cv2.CV_64F), dtype=np.float64)
        return NetworkObservation(self, integral, view.inside)


@dataclass(frozen=True, slots=True)
class NetworkObservation:
    """The integral image of one map."""

    likelihood: NetworkLikelihood
    integral: NDArray[np.float64]
    """(h + 1, w + 1)"""
    inside: NDArray[np.int32]

    def score(self, states: States) -> NDArray[np.float64]:
        """The untempered log ratio (n,); -inf for a box that leaves the polygon."""
        return _scores(self.integral, self.inside, states, self.likelihood.threshold, LEAST_INSIDE)

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """See `Observation`."""
        return bounded(self.score(states), self.likelihood.evidence, self.likelihood.bound)


@njit(cache=True)
def _scores(integral, inside, states, threshold, least_inside):  # type: ignore[no-untyped-def]
    out = np.full(len(states), -np.inf)
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    for i in range(len(states)):
        box, share = box_inside(inside, states[i])
        if share < least_inside:
            continue
        x0, y0, x1, y1 = box_edges(states[i], _RING, width, height)
        area = (box[2] - box[0]) * (box[3] - box[1])
        total = box_sum(integral, box[0], box[1], box[2], box[3])
        around = (x1 - x0) * (y1 - y0) - area
        ring = (box_sum(integral, x0, y0, x1, y1) - total) / around if around > 0 else threshold
        out[i] = total / area - max(threshold, ring)
    return out
