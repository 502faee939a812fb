"""Every subtractor on the same pictures: masks and seconds a frame."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground
from tests.reproduction.paper3_background import contrib

OURS, PAPER = "ours", "ours, as the papers have it"


class Subtractor(Protocol):
    def apply(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]: ...


class Found(NamedTuple):
    """What one method made of some pictures."""

    masks: NDArray[np.bool_]
    seconds: NDArray[np.float64]


class _Opencv:
    """A subtractor of OpenCV's."""

    def __init__(self, subtractor: cv2.BackgroundSubtractor) -> None:
        self._subtractor = subtractor

    def apply(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return self._subtractor.apply(picture).astype(np.uint8, copy=False)


def own_methods(threads: int = 1) -> dict[str, Callable[[], Subtractor]]:
    """Those that run in this process, all with their defaults."""
    return {
        OURS: lambda: StatisticalBackground(BackgroundOptions(threads=threads)),
        PAPER: lambda: StatisticalBackground(
            BackgroundOptions(
                threads=threads,
                rule="paper",
                once_off="swap",
                noise_floor=0.0,
                learn_every=1,
                darkest_shadow=1.0,
            )
        ),
        "MOG2": lambda: _Opencv(cv2.createBackgroundSubtractorMOG2()),
        "KNN": lambda: _Opencv(cv2.createBackgroundSubtractorKNN()),
    }


def contrib_python() -> str | None:
    """The interpreter with opencv-contrib, where one is named."""
    return os.environ.get("LUMPWATCH_CONTRIB_PYTHON")


def run_all(pictures: NDArray[np.uint8], threads: int = 1) -> dict[str, Found]:
    """All methods on the pictures (n, h, w, 3), one after the other.

    Shadow pixels (127) of MOG2 and KNN are no foreground. Seconds of one thread are CPU time, which other
    work on the machine hardly changes; those of several are of the wall clock.
    """
    cv2.setNumThreads(threads)
    clock = time.process_time if threads == 1 else time.perf_counter
    found: dict[str, Found] = {}
    for name, make in own_methods(threads).items():
        subtractor, masks, seconds = make(), np.empty(pictures.shape[:3], np.bool_), np.empty(len(pictures))
        for i, picture in enumerate(pictures):
            began = clock()
            mask = subtractor.apply(picture)
            seconds[i] = clock() - began
            masks[i] = mask == 255
        found[name] = Found(masks, seconds)
    if python := contrib_python():
        found |= _run_contrib(python, pictures, threads)
    return found


def _run_contrib(python: str, pictures: NDArray[np.uint8], threads: int) -> dict[str, Found]:
    with tempfile.TemporaryDirectory() as folder:
        given, taken = Path(folder) / "pictures.npy", Path(folder) / "masks.npz"
        np.save(given, pictures)
        subprocess.run([python, contrib.__file__, given, taken, str(threads)], check=True)
        with np.load(taken) as saved:
            pixels = int(np.prod(pictures.shape[1:3]))
            return {
                name: Found(
                    np.unpackbits(saved[name], axis=1)[:, :pixels]
                    .astype(np.bool_)
                    .reshape(pictures.shape[:3]),
                    saved[f"{name}_s"],
                )
                for name in contrib.METHODS
            }
