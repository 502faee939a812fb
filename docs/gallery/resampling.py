"""How resampling rounds.

Twenty weights are resampled to twenty particles a thousand times. All three ways give each particle as many copies as
it is worth on average; they differ in how much the number of copies varies.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lumpwatch.models import multinomial, stratified, systematic


def main(picture: Path = Path("resampling.png")) -> None:
    """Count copies."""
    rng = np.random.default_rng(1)
    weights = rng.exponential(1.0, 20)
    order = np.argsort(weights)
    expected = 20.0 * weights / weights.sum()
    figure, axes = plt.subplots(1, 3, figsize=(12, 3), sharey=True, layout="constrained")
    for axis, resample in zip(axes, (multinomial, stratified, systematic), strict=True):
        copies = np.array([np.bincount(resample(weights, 20, rng), minlength=20) for _ in range(1000)])
        axis.errorbar(
            np.arange(20), copies.mean(axis=0)[order], copies.std(axis=0)[order], fmt="o", capsize=3
        )
        axis.plot(expected[order], "k_", markersize=12, label="20 times the weight")
        axis.set(title=resample.__name__, xlabel="particle, by weight")
    axes[0].set(ylabel="copies: mean and deviation")
    axes[0].legend()
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
