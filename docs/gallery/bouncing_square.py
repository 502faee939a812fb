"""A square that bounces.

Joint detection and tracking (paper 1): the filter says with what probability something is there, and where. Grey is the
time in which the square is shown; noise of 50 grey levels.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from docs.experiments.square.scene import EMPTY, FPS, SHOWN, make_scene
from docs.gallery.square import learned, make_filter, region
from lumpwatch.models import Bounce, ConstantVelocity


def main(picture: Path = Path("bouncing_square.png")) -> None:
    """Learn on one clip, follow on another."""
    likelihood, clip, roi = learned(make_scene(0, noise=50.0)), make_scene(1, noise=50.0), region()
    models = (ConstantVelocity("straight", 60.0), Bounce("bounce", 60.0, along_x=True, along_y=False))
    jdt = make_filter(models, np.array([[0.9, 0.1], [1.0, 0.0]]))
    rng = np.random.default_rng(1)
    belief, existence, x = jdt.start(rng), [], []
    for gray in clip.pictures:
        step = jdt.step(belief, likelihood.observe(roi.view(gray)), 1.0 / FPS, rng)
        belief = step.belief
        existence.append(belief.existence)
        x.append(step.estimate.mean[0] if step.estimate and belief.existence > 0.5 else np.nan)
    figure, axes = plt.subplots(1, 3, figsize=(13, 3), layout="constrained", width_ratios=[1, 2, 2])
    axes[0].imshow(clip.pictures[EMPTY + 20], cmap="gray")
    axes[0].set(title="one picture", xticks=[], yticks=[])
    for axis in axes[1:]:
        axis.axvspan(EMPTY, EMPTY + SHOWN, color="0.9")
    axes[1].plot(existence)
    axes[1].set(title="P(something is there)", xlabel="picture")
    axes[2].plot(np.arange(EMPTY, EMPTY + SHOWN), clip.centres[:, 0], color="0.5", label="truth")
    axes[2].plot(x, ".", label="estimate")
    axes[2].set(title="x (px)", xlabel="picture")
    axes[2].legend()
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
