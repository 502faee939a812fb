"""Pictures to look at."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import StatisticalBackground
from tests.footage import footage_folder, sketch

mpl.use("Agg")
from matplotlib import pyplot as plt

Image = NDArray[np.uint8]
HIGHWAY_FRAMES = (200, 500, 900)


def grid(rows: list[list[Image]], titles: list[str], names: list[str], path: Path) -> None:
    """Rows of pictures, BGR or masks, with a title over each column and a name before each row."""
    h, w = rows[0][0].shape[:2]
    width = 2.4 * len(titles)
    figure, axes = plt.subplots(
        len(rows), len(titles), figsize=(width, width * h / w * len(rows) / len(titles) + 0.4), squeeze=False
    )
    for r, row in enumerate(rows):
        for c, picture in enumerate(row):
            ax = axes[r, c]
            if picture.ndim == 3:
                ax.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
            else:
                ax.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            ax.set(xticks=[], yticks=[])
            if r == 0:
                ax.set_title(titles[c], fontsize=9)
        axes[r, 0].set_ylabel(names[r], fontsize=9)
    figure.tight_layout(pad=0.4)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def highway(path: Path) -> bool:
    """Real cars on a motorway; False where the footage is missing."""
    folder = footage_folder("highway", "video03.avi")
    if folder is None:
        return False
    capture = cv2.VideoCapture(str(folder / "video03.avi"))
    ours, mog2 = StatisticalBackground(), cv2.createBackgroundSubtractorMOG2()
    rows: list[list[Image]] = []
    for frame in range(max(HIGHWAY_FRAMES) + 1):
        good, read = capture.read()
        if not good:
            break
        picture = read.astype(np.uint8, copy=False)
        mask, other = ours.apply(picture), mog2.apply(picture)
        if frame in HIGHWAY_FRAMES:
            rows.append([sketch(picture), mask, np.where(other == 255, 255, 0).astype(np.uint8)])
    capture.release()
    titles = ["line drawing of the picture", "ours", "MOG2 without shadow pixels"]
    grid(rows, titles, [f"frame {frame}" for frame in HIGHWAY_FRAMES[: len(rows)]], path)
    return True
