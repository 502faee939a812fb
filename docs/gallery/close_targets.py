"""Targets that move side by side.

Two targets come as close as 3 px, measured to 2 px. The sum over all pairings (JPDA, paper 3) draws their estimates
together; JPDA*, the default, keeps the more probable pairing alone and them apart.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lumpwatch.models import ColourOptions, JpdaOptions, JpdaTracker


def main(picture: Path = Path("close_targets.png")) -> None:
    """Track the same measurements both ways."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 3), sharey=True, layout="constrained")
    for axis, association in zip(axes, ("jpda", "jpda_star"), strict=True):
        rng = np.random.default_rng(3)
        options = JpdaOptions(
            association=association, colour=ColourOptions(weight=0.0), space_weight=1.0, split=False,
            birth_apart=0.0, shared_s=100.0,
        )  # fmt: skip
        tracker = JpdaTracker(options, shape=(240, 360))
        for k in range(200):
            away = 1.5 + 0.25 * max(0.0, 60.0 - k, k - 140.0)
            centres = np.array([[100.0 - away, 20.0 + k], [100.0 + away, 20.0 + k]])
            measured = centres + rng.normal(0.0, 2.0, (2, 2))
            axis.plot([k, k], measured[:, 0], ".", color="0.8", markersize=3)
            for one in tracker.step(np.hstack([measured, np.full((2, 2), 6.0)]), dt=1 / 30):
                axis.plot(k, one.box[0], ".", color=f"C{one.id}", markersize=3)
        axis.set(title=association, xlabel="picture")
    axes[0].set(ylabel="x (px); grey: measured")
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
