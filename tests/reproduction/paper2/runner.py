"""One run of a tracker over all pictures, in a worker that shares the grids with the others."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import Scores, Tracks, evaluate, tracks_of
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.models.trackers.imm_pf import ImmPfTracker, PictureGrids, TrackerOptions
from lumpwatch.models.trackers.tracked import TrackedObject
from tests.reproduction.paper2.footage import FPS, FRAMES, LEARNED, Knowledge, Learned, part_of, pictures
from tests.reproduction.paper2.methods import make_models

THRESHOLD = 0.5
COSTED = 400
"""Pictures over which the whole cost is measured."""
PARTS = {"first": (1, LEARNED), "second": (LEARNED + 1, FRAMES), "whole": (1, FRAMES)}
Objects = list[tuple[TrackedObject, ...]]


@dataclass(frozen=True, slots=True)
class Task:
    """What a worker does."""

    kinds: tuple[str, ...]
    seed: int
    options: TrackerOptions
    keep: bool = False
    """Whether the objects come back as well."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run, measured."""

    scores: dict[str, Scores]
    """By part of the sequence."""
    seconds: float
    """Of the worker's processor, without looking at the pictures."""
    targets: int
    """Targets with a filter, confirmed or not, summed over the frames."""
    objects: Objects


def save(learned: Learned, place: Path) -> None:
    """Store the grids where workers can map them."""
    for name in ("colour", "motion", "foreground"):
        np.save(place / f"{name}.npy", getattr(learned, name))


class _Shared:
    """What every task of this worker needs."""

    def __init__(self, place: Path, shape: tuple[int, int], knowledge: Knowledge, truth: Tracks) -> None:
        colour, motion, foreground = (
            np.load(place / f"{name}.npy", mmap_mode="r") for name in ("colour", "motion", "foreground")
        )
        self.grids = [
            # copies in memory: some 260 MB
            PictureGrids(np.array(colour[k]), np.array(motion[k]), np.array(foreground[k]), shape)
            for k in range(len(colour))
        ]
        self.knowledge, self.truth = knowledge, truth


_shared: list[_Shared] = []


def initialise(place: Path, shape: tuple[int, int], knowledge: Knowledge, truth: Tracks) -> None:
    """Prepare a worker; its share of the machine is one core."""
    cv2.setNumThreads(1)
    _shared[:] = [_Shared(place, shape, knowledge, truth)]


class NoForeground:
    """Stands where the masks were made beforehand."""

    def apply(self, picture: NDArray[np.uint8], learn: bool = True) -> NDArray[np.uint8]:
        """Never called."""
        raise NotImplementedError


def run(task: Task) -> Outcome:
    """Track through all pictures and measure the parts."""
    shared = _shared[0]
    tracker = ImmPfTracker(
        task.options,
        make_models(task.kinds, shared.knowledge),
        shared.knowledge.size,
        NoForeground(),
        np.random.default_rng(task.seed),
    )
    began = time.process_time()
    objects = [tracker.advance(seen, 1.0 / FPS) for seen in shared.grids]
    seconds = time.process_time() - began
    return Outcome(
        measure(result_of(objects), shared.truth),
        seconds,
        sum(len(some) for some in objects),
        objects if task.keep else [],
    )


def whole_cost(video: Path, kinds: tuple[str, ...], knowledge: Knowledge) -> float:
    """Seconds of one core for a picture, with decoding, background subtraction and all targets."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    models, rng = make_models(kinds, knowledge), np.random.default_rng(0)
    tracker = ImmPfTracker(TrackerOptions(), models, knowledge.size, MixtureForeground(), rng)
    began, count = time.process_time(), 0
    for picture in islice(pictures(video), COSTED):
        tracker.step(picture, 1.0 / FPS)
        count += 1
    cv2.setNumThreads(threads)
    return (time.process_time() - began) / count


def result_of(objects: Objects) -> Tracks:
    """The confirmed objects as tracks, frames counted from 1."""
    rows = [
        (frame, one.id, *(one.box[:2] - one.box[2:] / 2), *one.box[2:])
        for frame, some in enumerate(objects, 1)
        for one in some
        if one.confirmed
    ]
    table = np.array(rows, dtype=float).reshape(-1, 6)
    return tracks_of(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:])


def measure(result: Tracks, truth: Tracks) -> dict[str, Scores]:
    """Scores of each part."""
    return {
        name: evaluate(part_of(result, *frames), part_of(truth, *frames), THRESHOLD)
        for name, frames in PARTS.items()
    }
