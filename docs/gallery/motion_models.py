"""What the motion models do.

Forty objects start with the same velocity and move for two seconds by each model. Noise is the exact discretisation of
a continuous process, so that any time step gives the same law.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lumpwatch.models import (
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    RandomWalk,
    blank,
)


def main(picture: Path = Path("motion_models.png")) -> None:
    """Draw the paths."""
    rng = np.random.default_rng(1)
    models = (
        ConstantPosition("constant position", 3.0),
        RandomWalk("random walk", 10.0),
        ConstantVelocity("constant velocity", 10.0),
        ConstantAcceleration("constant acceleration", (0.0, 40.0), 5.0),
        Bounce("bounce, once, at half time", 5.0, along_x=True, along_y=False),
    )
    figure, axes = plt.subplots(
        1, len(models), figsize=(13, 2.8), sharex=True, sharey=True, layout="constrained"
    )
    straight = models[2]
    for axis, model in zip(axes, models, strict=True):
        states = blank(40)
        states[:, 2:4] = 40.0, 10.0  # columns are x, y, vx, vy, ax, ay, width, height
        path = [states]
        for k in range(40):
            moves = (model if k == 20 else straight) if model.momentary else model
            states = moves.move(states, 0.05, rng)
            path.append(states)
        axis.plot(*np.moveaxis(np.array(path)[:, :, :2], -1, 0), color="tab:blue", alpha=0.3, linewidth=0.8)
        axis.set(title=model.name, xlabel="x (px)")
    axes[0].set(ylabel="y (px)")
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
