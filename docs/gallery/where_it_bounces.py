"""Where it bounces, learned from one track.

The density of the places before each motion model (paper 1, Eq. 14), and what Eq. 12 makes of it: the probability
that the next step is a bounce, by place, beside that of the fixed matrix.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from docs.experiments.square.scene import FPS, HEIGHT, WIDTH, make_scene
from lumpwatch.models import AdaptiveSwitching, FixedSwitching, blank, learn_density


def main(picture: Path = Path("where_it_bounces.png")) -> None:
    """Learn from three clips."""
    places, labels = [], []
    for seed in range(3):
        clip = make_scene(seed, noise=0.0)
        places += clip.centres[:-1].tolist()  # where the square is before each step
        labels += clip.bounced[1:].tolist()
    before = blank(len(places))
    before[:, :2] = places
    bounced = np.array(labels)
    share = bounced.mean()
    matrix = np.array([[1.0 - share, share], [1.0, 0.0]])
    momentary = np.array([False, True])
    density = learn_density(before, bounced.astype(np.intp), models=2, components=(0,), least_bandwidth=3.0)
    fixed = FixedSwitching(matrix, 1.0 / FPS, momentary)
    adaptive = AdaptiveSwitching(matrix, 1.0 / FPS, momentary, density)
    states = blank(WIDTH)
    states[:, 0], states[:, 1] = np.arange(WIDTH), HEIGHT / 2
    straight = np.zeros(WIDTH, np.intp)
    figure, axis = plt.subplots(figsize=(7, 3), layout="constrained")
    for name, switching in (("fixed matrix (Eq. 10)", fixed), ("adaptive (Eq. 12)", adaptive)):
        axis.plot(switching.rows(states, straight, 1.0 / FPS)[0][:, 1], label=name)
    axis.plot(before[bounced, 0], np.zeros(bounced.sum()), "k|", label="bounces")
    axis.set(xlabel="x (px)", ylabel="P(next step is a bounce)")
    axis.legend()
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
