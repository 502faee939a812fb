"""Where the real footage lies that the repository does not hold, and how pages show it all the same."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def footage_folder(name: str, *files: str) -> Path | None:
    """The footage of that name, or None where it or one of its `files` is missing.

    It is looked for in $LUMPWATCH_FOOTAGE, then in ../shared/data beside the repository.
    """
    root = os.environ.get("LUMPWATCH_FOOTAGE")
    base = Path(root) if root else Path(__file__).parents[2] / "shared" / "data"
    folder = base / name
    return folder if folder.is_dir() and all((folder / file).is_file() for file in files) else None


def sketch(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A line drawing (h, w, 3) of a picture, gray or BGR: footage itself goes into no page."""
    gray = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    edges = cv2.Canny(cv2.GaussianBlur(gray, (0, 0), 1.5), 30, 90)
    lines = np.where(edges > 0, 150, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(lines, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
