"""A likelihood of your own.

A likelihood looks at a picture once and is then asked about any number of states. This one compares the contrast of a
box with that of the ground: a sum and a sum of squares by integral images, so that a box costs eight look-ups.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from docs.experiments.square.scene import EMPTY, FPS, HEIGHT, SHOWN, SIDE, WIDTH, make_scene
from docs.gallery.square import make_filter, region
from lumpwatch.models import Bounce, ConstantVelocity, View, blank


@dataclass(frozen=True)
class Contrast:
    """Log likelihood ratio slope (s - least), s the standard deviation of the grey levels within the box."""

    least: float
    slope: float

    def observe(self, view: View, dt: float = inf) -> ContrastSeen:
        """Look at the picture once."""
        return ContrastSeen(self, *cv2.integral2(view.gray, sdepth=cv2.CV_64F, sqdepth=cv2.CV_64F))


@dataclass(frozen=True)
class ContrastSeen:
    """One picture, ready to be asked."""

    rule: Contrast
    sums: NDArray[np.float64]
    squares: NDArray[np.float64]

    def log_ratio(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log likelihood ratios (n,) of states (n, 8)."""
        low = np.round(states[:, :2] - 0.5 * states[:, 6:]).astype(int)
        high = np.round(states[:, :2] + 0.5 * states[:, 6:]).astype(int)
        inside = np.all((low >= 0) & (high <= (WIDTH, HEIGHT)) & (high > low), axis=1)
        (x0, y0), (x1, y1) = (np.where(inside, corner.T, [[0], [0]]) for corner in (low, np.maximum(high, 1)))
        area = np.maximum((x1 - x0) * (y1 - y0), 1)
        mean, square = (
            (table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]) / area
            for table in (self.sums, self.squares)
        )
        deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
        return np.where(inside, np.clip(self.rule.slope * (deviation - self.rule.least), -6.0, 6.0), -6.0)


def main(picture: Path = Path("own_likelihood.png")) -> None:
    """Follow the square by its contrast."""
    clip, roi, rng = make_scene(3, noise=30.0), region(), np.random.default_rng(3)
    likelihood = Contrast(least=45.0, slope=0.3)
    models = (ConstantVelocity("straight", 60.0), Bounce("bounce", 60.0, along_x=True, along_y=False))
    jdt = make_filter(models, np.array([[0.9, 0.1], [1.0, 0.0]]))
    belief, existence = jdt.start(rng), []
    for gray in clip.pictures:
        belief = jdt.step(belief, likelihood.observe(roi.view(gray)), 1.0 / FPS, rng).belief
        existence.append(belief.existence)
    grid = blank(WIDTH * HEIGHT)
    grid[:, 0], grid[:, 1] = (axis.ravel() for axis in np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)))
    grid[:, 6:] = SIDE
    shown = clip.pictures[EMPTY + 30]
    ratios = likelihood.observe(roi.view(shown)).log_ratio(grid).reshape(HEIGHT, WIDTH)
    figure, axes = plt.subplots(1, 3, figsize=(12, 2.8), layout="constrained")
    axes[0].imshow(shown, cmap="gray")
    axes[1].imshow(ratios)
    axes[1].set(title="log likelihood ratio of a box centred here")
    axes[2].axvspan(EMPTY, EMPTY + SHOWN, color="0.9")
    axes[2].plot(existence)
    axes[2].set(title="P(something is there)", xlabel="picture")
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
