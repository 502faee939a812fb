"""A small convolutional net that looks at a picture once and gives maps: where bodies are, and how far they reach.

The grey picture is halved, freed of its local mean and contrast, and folded so that the four pixels of a 2 x 2 block
become four channels of one cell: a cell is `STRIDE` pixels of the picture wide. Layers at one, two, four and eight
cells a step follow, joined again on the way back (U-net: Ronneberger, Fischer, Brox 2015). For each cell the net tells

    body        the logit that the cell lies on a body with an outline, of whatever size
    edge        the logit that an outline passes through it
    left, upper, right, lower    log(distance + `REACH`) from the cell's middle to the sides of the box of its
                body, px (FCOS: Tian, Shen, Chen, He 2019)

What a body is made of does not matter, and neither does its size: what is large is for the box's score to say.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.likelihood import onnx
from lumpwatch.models.likelihood.runtime import OnnxModel
from lumpwatch.models.roi import Image

STRIDE = 4
"""Pixels of the picture in a cell, each way."""
REACH = 4.0
"""Added to distances before their logarithm, px."""
STEM, FINE, MIDDLE, DEEP, DEEPEST = 4, 16, 48, 64, 96
"""Channels of what goes in, and of the layers at one, two, four and eight cells a step."""
HEADS = ("body", "edge", "left", "upper", "right", "lower")
_ROUND = 8 * STRIDE
_WINDOW = 49  # halved pixels over which mean and contrast are taken
_LEAST_CONTRAST = 2.0  # grey levels

Weights = Mapping[str, NDArray[np.float32]]
"""Of each layer `name`: `name_weight` (out, in, k, k) and `name_bias` (out,)."""

SHAPES: dict[str, tuple[int, int, int]] = {
    "stem": (FINE, STEM, 3), "fine": (FINE, FINE, 3), "down": (MIDDLE, FINE, 3), "middle": (MIDDLE, MIDDLE, 3),
    "deeper": (DEEP, MIDDLE, 3), "deep0": (DEEP, DEEP, 3), "deep1": (DEEP, DEEP, 3), "deep2": (DEEP, DEEP, 3),
    "deepest": (DEEPEST, DEEP, 3), "deepest0": (DEEPEST, DEEPEST, 3), "deepest1": (DEEPEST, DEEPEST, 3),
    "rise": (DEEP, DEEPEST, 1), "gathered": (DEEP, DEEP, 3),
    "up": (MIDDLE, DEEP, 1), "joined": (MIDDLE, MIDDLE, 3), "upper": (FINE, MIDDLE, 1), "finish": (FINE, FINE, 3),
    "heads": (len(HEADS), FINE, 1),
}  # fmt: skip
"""Channels out, channels in and width of each layer's kernels."""


def normalised(gray: Image) -> NDArray[np.float32]:
    """What the net takes of a picture (h, w): (4, h / 4, w / 4), both sides rounded up to whole steps.

    The picture's last row and column stand for what is added.
    """
    h, w = gray.shape
    below, right = -h % _ROUND, -w % _ROUND
    if below or right:
        gray = np.asarray(cv2.copyMakeBorder(gray, 0, below, 0, right, cv2.BORDER_REPLICATE), np.uint8)
    size = (gray.shape[1] // 2, gray.shape[0] // 2)
    half = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.float32)
    window = (_WINDOW, _WINDOW)
    mean = cv2.boxFilter(half, -1, window, borderType=cv2.BORDER_REFLECT)
    square = cv2.sqrBoxFilter(half, cv2.CV_32F, window, borderType=cv2.BORDER_REFLECT)
    variance = np.maximum(square - mean * mean, 0.0)
    # Half of it is the whole picture's: within a large smooth body noise is not to become a texture.
    spread = np.sqrt(0.5 * variance + 0.5 * float(variance.mean())) + _LEAST_CONTRAST
    flat = ((half - mean) / spread).astype(np.float32, copy=False)
    folded = flat.reshape(size[1] // 2, 2, size[0] // 2, 2)
    return np.ascontiguousarray(folded.transpose(1, 3, 0, 2).reshape(STEM, size[1] // 2, size[0] // 2))


class Net:
    """Runs the net; the same picture gives the same bytes."""

    def __init__(self, weights: Weights) -> None:
        """Raises ValueError where a layer is missing or has another shape."""
        for name, (out, into, k) in SHAPES.items():
            if weights[f"{name}_weight"].shape != (out, into, k, k) or weights[f"{name}_bias"].shape != (
                out,
            ):
                raise ValueError(f"layer {name} of the net has another shape")
        self._model = OnnxModel(_graph(weights))

    def __call__(self, gray: Image) -> NDArray[np.float32]:
        """The maps of a picture (h, w), in the order of `HEADS`, (6, rows, columns) of cells that cover it."""
        h, w = gray.shape
        return self._model(normalised(gray)[None])[0, :, : -(-h // STRIDE), : -(-w // STRIDE)]


class Remembered:
    """Maps of pictures that are asked for again and again: the net looks at each once.

    A picture is known by its place in memory, so it has to live, unchanged, as long as this does.
    """

    def __init__(self, net: Net) -> None:
        self._net = net
        self._maps: dict[int, NDArray[np.float16]] = {}

    def __call__(self, gray: Image) -> NDArray[np.float32]:
        """See `Net`; told in half as many digits."""
        maps = self._maps.get(id(gray))
        if maps is None:
            maps = self._maps[id(gray)] = self._net(gray).astype(np.float16)
        return maps.astype(np.float32)


def _graph(weights: Weights) -> bytes:
    graph = onnx.Graph("picture", ("n", STEM, "h", "w"))

    def layer(name: str, x: str, stride: int = 1, *, relu: bool = True) -> str:
        made = graph.conv(x, weights[f"{name}_weight"], weights[f"{name}_bias"], stride)
        return graph.relu(made) if relu else made

    x = layer("stem", "picture")
    fine = graph.add(x, layer("fine", x))
    x = layer("down", fine, 2)
    middle = graph.add(x, layer("middle", x))
    x = layer("deeper", middle, 2)
    for name in ("deep0", "deep1", "deep2"):
        x = graph.add(x, layer(name, x))
    deep = x
    x = layer("deepest", deep, 2)
    for name in ("deepest0", "deepest1"):
        x = graph.add(x, layer(name, x))
    x = graph.add(deep, graph.doubled(layer("rise", x, relu=False)))
    x = graph.add(x, layer("gathered", x))
    x = graph.add(middle, graph.doubled(layer("up", x, relu=False)))
    x = graph.add(x, layer("joined", x))
    x = graph.add(fine, graph.doubled(layer("upper", x, relu=False)))
    x = graph.add(x, layer("finish", x))
    return graph.model(layer("heads", x, relu=False), ("n", len(HEADS), "h", "w"))
