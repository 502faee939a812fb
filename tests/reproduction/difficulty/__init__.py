"""Ours and its peers on the matrix of difficulty: lumps announced in time, warning times, false alarms, sizes.

peers    the methods, each with its configuration and its thresholds
simple   the two that follow nothing
work     one feed watched by several methods, results kept on disk
plan     which feeds, in what order
judge    curves, best thresholds, cells of the matrix, exact tests
sizes    stated sizes against true ones
results  everything judged, from what is on disk
page     the page; plots: its pictures
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import replace
from pathlib import Path

from lumpwatch.service.batch import ClusterWorkers, LocalWorkers
from tests.reproduction.difficulty import page, plots
from tests.reproduction.difficulty.plan import PARTS, SMALL, STYLES, Plan, every_task
from tests.reproduction.difficulty.results import judge_all
from tests.reproduction.difficulty.work import ROOT, Task, digest, learn, missing, watch

DOCS = Path(__file__).parents[3] / "docs"
WORKERS = 2


def main(arguments: Sequence[str] = ()) -> None:
    """Watch what has not been watched, then write the page of what has."""
    asked = _parser().parse_args(arguments)
    plan = SMALL if asked.small else Plan()
    if asked.seeds:
        plan = replace(plan, test_lumps=min(plan.test_lumps, asked.seeds))
    if asked.hours:
        plan = replace(plan, long_feeds=round(asked.hours * 3600 / plan.long_s / len(STYLES)))
    if asked.scenes:
        plan = replace(plan, scenes=tuple(asked.scenes.split(",")))
    out = DOCS if asked.out is None else asked.out
    folder = ROOT / digest()
    if asked.fresh:
        shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    parts = asked.part or list(PARTS)
    deadline = None if asked.minutes is None else time.monotonic() + 60.0 * asked.minutes
    tasks = list(every_task(plan, parts))
    if asked.dask:
        with ClusterWorkers(asked.dask) as cluster:
            run(folder, tasks, deadline, cluster, lambda: digest() == folder.name, cluster.width())
    else:
        with LocalWorkers(WORKERS) as pool:
            run(folder, tasks, deadline, pool, lambda: digest() == folder.name)
    found = judge_all(folder, plan)
    for place in (out / "images", out / "results"):
        place.mkdir(parents=True, exist_ok=True)
    plots.draw(found, out / "images")
    path = out / "results" / "difficulty.md"
    path.write_text(page.write(found), encoding="utf-8")
    print(f"  wrote {path}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m tests.reproduction difficulty", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--part", action="append", choices=PARTS, help="only these (may be repeated)")
    parser.add_argument("--minutes", type=float, help="begin nothing new after this many minutes")
    parser.add_argument("--fresh", action="store_true", help="forget what was watched before")
    parser.add_argument("--small", action="store_true", help="little of everything, to see that it works")
    parser.add_argument("--seeds", type=int, help="test feeds of the standard scenes with lumps")
    parser.add_argument("--hours", type=float, help="length of the long run without lumps")
    parser.add_argument("--scenes", help="scenes of the matrix, by commas; left out: all")
    parser.add_argument("--out", type=Path, help="folder in the place of docs/")
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="on a Dask cluster whose workers have this checkout at the same path",
    )
    return parser


def run(
    folder: Path,
    tasks: Sequence[Task],
    deadline: float | None,
    pool: Executor,
    unchanged: Callable[[], bool] = lambda: True,
    workers: int = WORKERS,
    teach: Callable[[Path, str], object] = learn,
    watch: Callable[[Path, Task], float] = watch,
) -> None:
    """Watch the feeds in their order; what is there already is left alone. Nothing begins after the deadline.

    Exits where `unchanged` says that the code is no longer the one that the folder is for: a worker that
    started later would run other code than the first, and their results lie side by side.
    """
    to_do = [task for task in tasks if missing(folder, task)]
    if not to_do:
        return
    print(f"  {len(to_do)} of {len(tasks)} feeds to watch; results are kept in {folder}", flush=True)
    began, done, cpu_s = time.monotonic(), 0, 0.0
    list(pool.map(teach, [folder] * len(STYLES), STYLES))
    left, waiting = iter(to_do), set[Future[float]]()
    while True:
        # Only as many are handed out as are worked on: the deadline holds for each.
        while len(waiting) < workers and (deadline is None or time.monotonic() < deadline):
            if (task := next(left, None)) is None:
                break
            waiting.add(pool.submit(watch, folder, task))
        if not waiting:
            return
        ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        for future in ready:
            cpu_s += future.result()
            done += 1
        if not unchanged():
            sys.exit(f"the code changed during the run: delete {folder} and begin anew")
        elapsed = time.monotonic() - began
        print(f"  {done} of {len(to_do)} feeds in {elapsed:.0f} s ({cpu_s:.0f} s of CPU)", flush=True)
