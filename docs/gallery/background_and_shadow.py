"""Background, foreground and shadows.

The statistical background model (paper 3) on generated traffic, over a textured road. A patch in
the colour of the road with 60 % of its light is laid beside a car: taken for shadow, or kept where that is asked.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

from docs.experiments.traffic.scene import LEARNING, make_sequence
from lumpwatch.models import BackgroundOptions, StatisticalBackground


def main(picture: Path = Path("background_and_shadow.png")) -> None:
    """Learn from two seconds and judge one picture twice."""
    models = {
        "shadows left out (the default)": StatisticalBackground(),
        "darkest_shadow=1: shadows kept": StatisticalBackground(BackgroundOptions(darkest_shadow=1.0)),
    }
    for k, shown in enumerate(make_sequence(3, LEARNING).pictures()):
        if k == LEARNING + 60:
            break
        for model in models.values():
            model.apply(shown)
    light = np.ones(shown.shape[:2], np.float32)
    light[100:150, 20:110] = 0.6
    light = np.asarray(cv2.GaussianBlur(light, (0, 0), 2.0))
    shaded = np.round(shown * light[..., None]).astype(np.uint8)
    figure, axes = plt.subplots(1, 3, figsize=(12, 2.9), layout="constrained")
    axes[0].imshow(shaded[..., ::-1])
    for axis, (name, model) in zip(axes[1:], models.items(), strict=True):
        axis.imshow(model.apply(shaded), cmap="gray")
        axis.set(title=name)
    for axis in axes:
        axis.set(xticks=[], yticks=[])
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
