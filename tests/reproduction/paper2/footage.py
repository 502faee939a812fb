"""PETS 2009 S2.L1, view 1: pictures, labels, and what is learned from the first half."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import Tracks, tracks_of
from lumpwatch.models.jdt.motion_prior import CellVelocities, flow_vectors, learn_cells
from lumpwatch.models.trackers.foreground import Foreground
from lumpwatch.models.trackers.imm_pf import LinearSize, PictureGrids, learn_linear, reduced
from tests.footage import footage_folder

FPS = 7.0
FRAMES, LEARNED = 795, 397
"""Frames are counted from 1; up to the second number they are learned from."""
CELL = 30.0
SLOWEST = 5.0
"""Flow below this (px/s) belongs to things that stand."""
Array = NDArray[np.float64]


def folder() -> Path | None:
    """Where the footage lies, if it is here."""
    return footage_folder("pets2009-s2l1-view001", "vtest.avi", "gt.txt")


def pictures(path: Path) -> Iterator[NDArray[np.uint8]]:
    """All pictures of a video file."""
    capture = cv2.VideoCapture(str(path))
    try:
        while True:
            good, picture = capture.read()
            if not good:
                return
            yield np.asarray(picture, dtype=np.uint8)
    finally:
        capture.release()


def read_truth(path: Path) -> Tracks:
    """The labels of a MOTChallenge file."""
    rows = np.loadtxt(path, delimiter=",", ndmin=2)
    return tracks_of(rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:6])


def part_of(tracks: Tracks, first: int, last: int) -> Tracks:
    """The boxes of some frames."""
    chosen = (tracks.frames >= first) & (tracks.frames <= last)
    return Tracks(tracks.frames[chosen], tracks.ids[chosen], tracks.boxes[chosen])


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What the trackers know of the scene; from the first half alone."""

    size: LinearSize
    cells: CellVelocities


@dataclass(frozen=True, slots=True)
class Learned:
    """Knowledge, and the grids of all pictures as they were stacked."""

    knowledge: Knowledge
    shape: tuple[int, int]
    colour: NDArray[np.uint8]
    motion: NDArray[np.uint8]
    foreground: NDArray[np.uint8]
    """(frames, h, w)."""


def learn(video: Path, truth: Tracks, foreground: Foreground) -> Learned:
    """Reduce each picture once; learn sizes from the labels and velocities from the flow of the foreground."""
    grids: list[PictureGrids] = []
    places, speeds = [], []
    before = gray_before = mask_before = None
    for picture in pictures(video):
        mask = foreground.apply(picture)
        grids.append(reduced(picture, before, mask))
        if len(grids) <= LEARNED:
            gray = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
            if gray_before is not None:
                where, speed = flow_vectors(gray_before, gray, 1.0 / FPS, mask_before)
                chosen = np.hypot(*speed.T) > SLOWEST
                places.append(where[chosen])
                speeds.append(speed[chosen])
            gray_before, mask_before = gray, mask
        before = picture
    labelled = part_of(truth, 1, LEARNED).boxes
    size = learn_linear(np.hstack([labelled[:, :2] + labelled[:, 2:] / 2, labelled[:, 2:]]))
    cells = learn_cells(np.concatenate(places), np.concatenate(speeds), grids[0].shape, CELL)
    return Learned(
        Knowledge(size, cells),
        grids[0].shape,
        np.stack([grid.colour for grid in grids]),
        np.stack([grid.motion for grid in grids]),
        np.stack([grid.foreground for grid in grids]),
    )
