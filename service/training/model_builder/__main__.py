"""Builds what ships, in some hours on two cores: `make model`.

    python -m lumpwatch.service.training.model_builder FOOTAGE FEEDS WORK OUT

FOOTAGE is the folder that holds `belt-ore` and `belt-cctv`, FEEDS one of sites with labels (`python -m
tests.reproduction.real.make_feeds … --split train`), WORK takes the pictures and checkpoints (what is there is not
made again), OUT is the file that `lumpwatch.service.detection.shipped_likelihood` reads.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import torch

from lumpwatch.models.likelihood.net import Net
from lumpwatch.service.training.model_builder.head import fit_head
from lumpwatch.service.training.model_builder.learn import read, train
from lumpwatch.service.training.model_builder.net import BodyNet
from lumpwatch.service.training.model_builder.pictures import Task, make
from lumpwatch.service.training.model_builder.ship import rounded, write
from lumpwatch.service.training.model_builder.sites import site_scenes

COMPOSITES, SIMULATED = 24, 10
"""Files of pictures."""
PICTURES = 500, 400
"""In each of them."""
FIRST_SEEDS = 1000, 3000
STEPS = 20_000
HEAD_EVERY, SITES_EVERY = 4, 4
"""One in so many pictures teaches the score of boxes."""


def tasks(footage: Path, work: Path) -> Iterator[Task]:
    """The files of pictures."""
    for kind, count, first, many in zip(
        ("real", "simulated"), (COMPOSITES, SIMULATED), FIRST_SEEDS, PICTURES, strict=True
    ):
        for seed in range(first, first + count):
            yield Task(footage, "train", kind, seed, many, work / f"{kind}-{seed}.npz")


def build(footage: Path, feeds: Path, work: Path, out: Path) -> None:
    """Pictures, net, score."""
    work.mkdir(parents=True, exist_ok=True)
    made = list(tasks(footage, work))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=context, max_workers=2) as pool:
        list(pool.map(make, [task for task in made if not task.out.exists()]))
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    files = [task.out for task in made]
    checkpoint = work / "net.pt"
    net = BodyNet()
    if checkpoint.exists():
        net.load_state_dict(torch.load(checkpoint))
    else:
        net = train(lambda: read(files), 0.0, 1, told=print, steps=STEPS)
        torch.save(net.state_dict(), checkpoint)
    weights = rounded(net.arrays())
    maps = Net({key: value.astype(np.float32) for key, value in weights.items()})
    write(out, weights, fit_head(files, site_scenes(feeds, SITES_EVERY), maps, HEAD_EVERY))


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    build(*(Path(one) for one in sys.argv[1:]))
