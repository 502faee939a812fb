"""What the scores measure.

Three objects cross; a perfect result is made worse in one way at a time: boxes jitter, boxes are left out, or two
identities are exchanged more and more often. SFDA sees boxes, ATA and IDF1 whole tracks.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lumpwatch.models import evaluate, tracks_of


def main(picture: Path = Path("scores.png")) -> None:
    """Score three kinds of damage."""
    rng = np.random.default_rng(1)
    frames, ids = np.tile(np.arange(1, 101), 3), np.repeat([1, 2, 3], 100)
    boxes = np.column_stack([3.0 * frames, 60.0 * ids, np.full(300, 40.0), np.full(300, 40.0)])
    truth = tracks_of(frames, ids, boxes)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3), sharey=True, layout="constrained")
    damage = np.linspace(0.0, 1.0, 11)
    for axis, kind in zip(
        axes, ("jitter, 10 px times", "share left out", "exchanges, 10 times"), strict=True
    ):
        rows = []
        for amount in damage:
            shown, kept, names = boxes.copy(), np.ones(300, np.bool_), ids.copy()
            if kind.startswith("jitter"):
                shown[:, :2] += rng.normal(0.0, 1.0, (300, 2)) * 10.0 * amount
            elif kind.startswith("share"):
                kept = rng.random(300) >= 0.9 * amount
            else:
                turns = (frames * round(10 * amount) // 100) % 2 == 1
                names = np.where(turns & (ids < 3), 3 - ids, ids)
            found = evaluate(tracks_of(frames[kept], names[kept], shown[kept]), truth)
            rows.append((found.sfda, found.ata, found.mota, found.idf1))
        for name, values in zip(("SFDA", "ATA", "MOTA", "IDF1"), np.transpose(rows), strict=True):
            axis.plot(damage, values, label=name)
        axis.set(xlabel=kind, ylim=(-0.05, 1.05))
    axes[0].legend()
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main()
