"""Which motion models? Ask the log evidence.

A step's `log_evidence` is log p(Z_t | Z_1:t-1) over that of a picture without an object; its sum over a clip compares
models on the same footage without any label. Too little noise loses the object, too much costs evidence, and so does a
model that is missing. The square jitters by a pixel a step, which no model of the list has: noise makes up for it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from docs.experiments.square.scene import FPS, make_scene
from docs.gallery.square import learned, make_filter, region
from lumpwatch.models import Bounce, ConstantVelocity, RandomWalk


def main(picture: Path = Path("model_choice.png")) -> None:
    """Sum the evidence of one clip for six choices, four runs each."""
    likelihood, clip, roi = learned(make_scene(0, noise=50.0)), make_scene(4, noise=50.0), region()
    bounce = Bounce("bounce", 60.0, along_x=True, along_y=False)
    both = np.array([[0.9, 0.1], [1.0, 0.0]])
    choices: dict[str, tuple[tuple[Any, ...], Any]] = {
        "straight and bounce, noise 60": ((ConstantVelocity("straight", 60.0), bounce), both),
        "the same, noise 20": ((ConstantVelocity("straight", 20.0), bounce), both),
        "the same, noise 150": ((ConstantVelocity("straight", 150.0), bounce), both),
        "straight alone, noise 60": ((ConstantVelocity("straight", 60.0),), np.eye(1)),
        "straight alone, noise 150": ((ConstantVelocity("straight", 150.0),), np.eye(1)),
        "random walk": ((RandomWalk("walk", 45.0),), np.eye(1)),
    }
    figure, axis = plt.subplots(figsize=(9, 3), layout="constrained")
    for name, (models, matrix) in choices.items():
        jdt, sums = make_filter(models, matrix), []
        for seed in range(4):
            rng, total = np.random.default_rng(seed), 0.0
            belief = jdt.start(rng)
            for gray in clip.pictures:
                step = jdt.step(belief, likelihood.observe(roi.view(gray)), 1.0 / FPS, rng)
                belief, total = step.belief, total + step.log_evidence
            sums.append(total)
        axis.barh(name, np.mean(sums), xerr=np.std(sums))
    axis.invert_yaxis()
    axis.set(xlabel="log evidence of the clip; bars: standard deviation over runs")
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
