"""Table 1 of paper 2 on PETS 2009 S2.L1, view 1: `python -m tests.reproduction.paper2 [--quick]`."""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

from lumpwatch.models.evaluation import Tracks
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.models.trackers.imm_pf import TrackerOptions
from tests.reproduction.paper2 import baseline, footage, page, plots
from tests.reproduction.paper2.methods import METHODS, OPTIONS
from tests.reproduction.paper2.runner import Outcome, Task, initialise, measure, run, save, whole_cost

DOCS = Path(__file__).parents[3] / "docs"
WORKERS = 2
RUNS = 30
SHOWN = "CP_CV_CA"
_seen = OPTIONS.observation
_often = replace(OPTIONS, filter=replace(OPTIONS.filter, all_every=1, model_every=0))
ABLATIONS: dict[str, tuple[str, TrackerOptions]] = {
    "CV_CA as chosen": ("CV_CA", OPTIONS),
    "no silhouette term": ("CV_CA", replace(OPTIONS, observation=replace(_seen, silhouette=0.0))),
    "histograms of the whole box": (
        "CV_CA",
        replace(OPTIONS, observation=replace(_seen, foreground_only=False)),
    ),
    "neighbours claim nothing": ("CV_CA", replace(OPTIONS, observation=replace(_seen, claim=0.0))),
    "no motion histogram": ("CV_CA", replace(OPTIONS, observation=replace(_seen, motion=0.0))),
    "lost targets forgotten at once": ("CV_CA", replace(OPTIONS, lost_s=0.0)),
    "silhouette, claims, foreground histograms and memory off (nearest to the paper)": (
        "CV_CA",
        replace(
            OPTIONS,
            observation=replace(_seen, silhouette=0.0, foreground_only=False, claim=0.0),
            lost_s=0.0,
        ),
    ),
    "CV_CA, resampled over all particles in every picture": ("CV_CA", _often),
    "CA alone, resampled in every picture": ("CA", _often),
    "MP alone, resampled in every picture": ("MP", _often),
}


def main(docs: Path = DOCS, runs: int = RUNS) -> None:
    """Learn, run all rows, and write the page and its pictures below `docs`."""
    place = footage.folder()
    if place is None:
        print("  paper2: skipped, because the PETS 2009 footage is not here")
        return
    (docs / "images").mkdir(parents=True, exist_ok=True)
    (docs / "results").mkdir(parents=True, exist_ok=True)
    truth = footage.read_truth(place / "gt.txt")
    began = time.monotonic()
    learned = footage.learn(place / "vtest.avi", truth, MixtureForeground())
    print(f"  learned: {time.monotonic() - began:.0f} s", flush=True)
    tasks = [Task(m.kinds, seed, OPTIONS) for m in METHODS for seed in range(runs)]
    tasks += [Task(tuple(SHOWN.split("_")), 0, OPTIONS, keep=True)]
    some = max(runs // 10, 1)
    tasks += [
        Task(tuple(row.split("_")), seed, options)
        for row, options in ABLATIONS.values()
        for seed in range(some)
    ]
    with tempfile.TemporaryDirectory() as folder:
        save(learned, Path(folder))
        # Forked workers would inherit OpenCV's threads in an unknown state.
        context = multiprocessing.get_context("spawn")
        arguments = (Path(folder), learned.shape, learned.knowledge, truth)
        with ProcessPoolExecutor(WORKERS, context, initialise, arguments) as pool:
            done = iter(list(pool.map(run, tasks)))
    table = {m.name: [next(done) for _ in range(runs)] for m in METHODS}
    shown = next(done)
    ablations = {name: [next(done) for _ in range(some)] for name in ABLATIONS}
    others = _baselines(learned, truth)
    plots.table(table, docs / "images" / "paper2_table.png")
    video = place / "vtest.avi"
    plots.paths(shown, video, SHOWN.split("_"), docs / "images" / "paper2_paths.png")
    plots.frame(shown, video, learned, docs / "images" / "paper2_frame.png")
    highway = plots.highway(docs / "images" / "paper2_highway.png")
    cost = whole_cost(video, tuple(SHOWN.split("_")), learned.knowledge)
    text = page.write(table, ablations, others, learned.knowledge, highway, cost)
    (docs / "results" / "paper2.md").write_text(text, encoding="utf-8")


def _baselines(learned: footage.Learned, truth: Tracks) -> dict[str, list[Outcome]]:
    if not baseline.available():
        return {}
    return {
        name: [Outcome(measure(baseline.follow(name, learned.foreground), truth), 0.0, 0, [])]
        for name in baseline.NAMES
    }
