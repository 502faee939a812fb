"""Paper 3's data association and tracker: `python -m tests.reproduction.paper3_jpda [--quick] [--out DIR]`."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from docs.experiments.traffic.scene import LEARNING, make_sequence
from lumpwatch.models.trackers.background.model import StatisticalBackground
from lumpwatch.models.trackers.background.options import BackgroundOptions
from lumpwatch.models.trackers.foreground import Foreground, MixtureForeground
from lumpwatch.models.trackers.jpda import Association, ColourOptions, JpdaOptions
from lumpwatch.models.trackers.jpda.tracker import Associator
from tests.reproduction.paper3_jpda import page, peers, plots
from tests.reproduction.paper3_jpda.simulation import PAPER, SETTINGS, Score, Setting, global_nearest, trial
from tests.reproduction.paper3_jpda.system import OPTIONS, Outcome, play

Array = NDArray[np.float64]
DOCS = Path(__file__).parents[3] / "docs"
SEEDS = tuple(range(50))
SEQUENCES = tuple(range(10))
WORKERS = 2
SITUATIONS = 25

FOREGROUNDS: dict[str, Callable[[], Foreground]] = {
    "statistical background": lambda: StatisticalBackground(BackgroundOptions(threads=2)),
    "MOG2": MixtureForeground,
}
SCENES = {"road empty while learning": LEARNING, "traffic while learning": 0}
"""Pictures at the start in which nothing comes."""


def nearest_in_tracker(
    likelihood: Array, detection: Array, clutter: float, gate_probability: float, exact: int
) -> Association:
    """Global nearest neighbour in the place of the joint association."""
    return global_nearest(likelihood, detection[:, None], clutter)


VARIANTS: dict[str, tuple[JpdaOptions, Associator | None]] = {
    "as it is": (OPTIONS, None),
    "JPDA over all pairings": (replace(OPTIONS, association="jpda"), None),
    "regions not cut": (replace(OPTIONS, split=False), None),
    "without colour": (replace(OPTIONS, colour=ColourOptions(weight=0.0)), None),
    "space alone, exponent 1": (
        replace(OPTIONS, colour=ColourOptions(weight=0.0), space_weight=1.0),
        None,
    ),
    "global nearest neighbour": (OPTIONS, nearest_in_tracker),
    "global nearest neighbour, regions not cut": (replace(OPTIONS, split=False), nearest_in_tracker),
}


def main(quick: bool = False, docs: Path = DOCS) -> None:
    """Run everything and write the page and its pictures below `docs`."""
    (docs / "images").mkdir(parents=True, exist_ok=True)
    (docs / "results").mkdir(parents=True, exist_ok=True)
    seeds, sequences = (SEEDS[:3], SEQUENCES[:2]) if quick else (SEEDS, SEQUENCES)
    # Timed alone, before the machine is shared with workers.
    whole = _whole_system(sequences)
    compared = [
        (setting, peers.compare(setting, 5 if quick else SITUATIONS) if peers.available() else [])
        for setting in (Setting("dense", 10, start="dense"), Setting("crossing", 20, 0.9, "crossing"))
    ]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=context, initializer=_one_core) as pool:
        simulated = _simulated(pool, seeds)
        variants = _variants(pool, sequences)
    plots.simulation(PAPER, docs / "images" / "jpda_simulation.png")
    plots.curves(simulated, docs / "images" / "jpda_curves.png")
    plots.traffic(sequences, FOREGROUNDS["statistical background"], docs / "images" / "jpda_traffic.png")
    text = page.write(simulated, compared, whole, variants)
    (docs / "results" / "jpda.md").write_text(text, encoding="utf-8")


def _one_core() -> None:
    cv2.setNumThreads(1)


def _whole_system(sequences: tuple[int, ...]) -> dict[str, dict[str, Outcome]]:
    """Each foreground on each sequence of each scene, in turn, with two threads."""
    cv2.setNumThreads(2)
    for make in FOREGROUNDS.values():  # compiles what is compiled
        play(make_sequence(1000, 0), make(), OPTIONS, frames=LEARNING + 10)
    total = {scene: {name: Outcome() for name in FOREGROUNDS} for scene in SCENES}
    for scene, empty in SCENES.items():
        for seed in sequences:
            for name, make in FOREGROUNDS.items():
                total[scene][name].add(play(make_sequence(seed, empty), make(), OPTIONS))
    return total


def _simulated(pool: Executor, seeds: tuple[int, ...]) -> dict[Setting, dict[str, list[Score]]]:
    tasks = [(setting, seed) for setting in SETTINGS for seed in seeds]
    results = list(pool.map(trial, *zip(*tasks, strict=True), chunksize=10))
    scores: dict[Setting, dict[str, list[Score]]] = {setting: {} for setting in SETTINGS}
    for (setting, _), result in zip(tasks, results, strict=True):
        for name, score in result.items():
            scores[setting].setdefault(name, []).append(score)
    return scores


def _variants(pool: Executor, sequences: tuple[int, ...]) -> dict[str, Outcome]:
    tasks = [(name, seed) for name in VARIANTS for seed in sequences]
    total = {name: Outcome() for name in VARIANTS}
    for (name, _), outcome in zip(tasks, pool.map(_variant, *zip(*tasks, strict=True)), strict=True):
        total[name].add(outcome)
    return total


def _variant(name: str, seed: int) -> Outcome:
    options, associator = VARIANTS[name]
    return play(make_sequence(seed, LEARNING), MixtureForeground(), options, associator)
