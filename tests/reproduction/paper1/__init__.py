"""The five experiments of paper 1, section 4: `python -m tests.reproduction.paper1 [--quick] [keys]`."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

from tests.reproduction.paper1 import page, plots
from tests.reproduction.paper1.experiments import EXPERIMENTS
from tests.reproduction.paper1.footage import football_folder
from tests.reproduction.paper1.methods import Experiment
from tests.reproduction.paper1.runner import initialise, play

DOCS = Path(__file__).parents[3] / "docs"
WORKERS = 2


def main(experiments: Sequence[Experiment] = EXPERIMENTS, docs: Path = DOCS) -> None:
    """Play the experiments, write the page and its pictures below `docs`."""
    (docs / "images").mkdir(parents=True, exist_ok=True)
    (docs / "results").mkdir(parents=True, exist_ok=True)
    results, skipped, images = [], [], {}
    # Forked workers would inherit OpenCV's threads in an unknown state.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=context, initializer=initialise) as pool:
        for experiment in experiments:
            if experiment.needs_footage and football_folder() is None:
                skipped.append(f"**{experiment.title}: skipped, because the footage is not here.**")
                continue
            began = time.monotonic()
            result = play(experiment, pool)
            name = f"paper1_{experiment.key}.png"
            plots.draw(result, docs / "images" / name)
            images[experiment.key] = f"../images/{name}"
            results.append(result)
            print(f"  {experiment.key}: {time.monotonic() - began:.0f} s", flush=True)
    (docs / "results" / "paper1.md").write_text(page.write(results, skipped, images), encoding="utf-8")


def shortened(experiment: Experiment) -> Experiment:
    """The experiment with few seeds, for developing."""
    return replace(
        experiment, training_seeds=experiment.training_seeds[:4], test_seeds=experiment.test_seeds[:4]
    )
