"""Nets and maps that the tests of `models` share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.likelihood.net import HEADS, REACH, SHAPES, STRIDE
from lumpwatch.models.roi import Image

Array = NDArray[np.float32]
SURE = 6.0
"""Logit of what the maps of `drawn` are sure of."""


def random_weights(seed: int) -> dict[str, Array]:
    """A net that nobody trained."""
    rng = np.random.default_rng(seed)
    weights = {}
    for name, (out, into, k) in SHAPES.items():
        spread = np.sqrt(1.0 / (into * k * k))
        weights[f"{name}_weight"] = rng.normal(0.0, spread, (out, into, k, k)).astype(np.float32)
        weights[f"{name}_bias"] = rng.normal(0.0, 0.1, out).astype(np.float32)
    return weights


def drawn(shape: tuple[int, int], bodies: list[tuple[int, int, int, int]]) -> Array:
    """Maps of a picture of that many rows and columns of cells, that knows its bodies: x0, y0, x1, y1 in cells."""
    maps = np.full((len(HEADS), *shape), -SURE, np.float32)
    maps[2:] = np.log(REACH)
    for x0, y0, x1, y1 in bodies:
        y, x = np.mgrid[y0:y1, x0:x1] + 0.5
        maps[0, y0:y1, x0:x1] = SURE
        maps[1, y0:y1, x0:x1] = SURE
        maps[1, y0 + 1 : y1 - 1, x0 + 1 : x1 - 1] = -SURE
        for k, side in enumerate((x - x0, y - y0, x1 - x, y1 - y)):
            maps[2 + k, y0:y1, x0:x1] = np.log(STRIDE * side + REACH)
    return maps


def nothing(gray: Image) -> Array:
    """Maps of a picture without a body."""
    return drawn((-(-gray.shape[0] // STRIDE), -(-gray.shape[1] // STRIDE)), [])
