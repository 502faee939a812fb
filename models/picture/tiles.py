"""Means over the tiles of a working picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

TILE = 16
"""Side of a tile in pixels of the working picture, about."""


def grid(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of tiles in a picture of this shape."""
    return max(round(shape[0] / TILE), 1), max(round(shape[1] / TILE), 1)


def tile_means(field: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    """Mean of each tile (rows, columns)."""
    return np.asarray(cv2.resize(field, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
