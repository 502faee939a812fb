"""Everything judged, from what has been watched so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumpwatch.service.offline.backtest.curve import Point
from tests.reproduction import matrix
from tests.reproduction.difficulty.judge import (
    NOTHING,
    Cell,
    best,
    cell,
    curve,
    done,
    judged,
)
from tests.reproduction.difficulty.peers import ALARM, OURS
from tests.reproduction.difficulty.plan import STYLES, Plan
from tests.reproduction.difficulty.sizes import Sizes, sizes
from tests.reproduction.difficulty.work import WARM_UP, Task, load

SHOWN = (0.5, 0.98, 0.99, 0.995)
"""Thresholds of the long run that are shown beside the chosen one and the default."""


@dataclass(frozen=True, slots=True)
class StyleResult:
    """One style of the feed: methods on its standard scene."""

    curves: dict[str, list[Point]]
    """On test feeds."""
    chosen: dict[str, Point]
    """Each method's best threshold, on training feeds."""
    tested: dict[str, Cell]
    """At that threshold, on test feeds."""
    choosing: tuple[int, int]
    """Training feeds with lumps, and without."""
    testing: tuple[int, int]
    """Test feeds, those with lumps of ours."""
    long: dict[tuple[str, float], Cell]
    """The long run without lumps: of a method at a threshold."""
    sizes: Sizes | None


@dataclass(frozen=True, slots=True)
class Results:
    """Everything."""

    plan: Plan
    styles: dict[str, StyleResult]
    matrix: dict[str, dict[str, Cell]]
    """Scene -> method -> on its test feeds, at the method's best threshold of the style."""
    feeds: dict[str, tuple[int, int]]
    """Scene -> test feeds with lumps, and without."""
    frame_ms: dict[str, float]
    """Median CPU time of a frame of each method, on the standard scenes."""


def judge_all(folder: Path, plan: Plan) -> Results:
    """Judge what is there; parts that are not there yet are left out."""
    keys = plan.peers
    styles = {style: found for style in STYLES if (found := _style(folder, plan, style, keys)) is not None}
    cells, feeds = {}, {}
    for scene in plan.matrix():
        lumps, empty = _by_all(folder, plan, plan.with_lumps(scene)), done(folder, plan.without(scene))
        if scene.spec.style not in styles or not lumps:
            continue
        chosen = styles[scene.spec.style].chosen
        feeds[scene.name] = len(lumps), len(empty)
        cells[scene.name] = {
            key: _cell(folder, [*lumps, *empty], key, chosen[key].raise_above) for key in keys
        }
    standard = [task for style in STYLES for task in plan.with_lumps(plan.standard(style))]
    standard = _by_all(folder, plan, standard)
    return Results(plan, styles, cells, feeds, _frame_ms(folder, plan, standard))


def _style(folder: Path, plan: Plan, style: str, keys: tuple[str, ...]) -> StyleResult | None:
    choosing, scene = done(folder, plan.choosing(style)), plan.standard(style)
    testing, long = done(folder, plan.testing(scene)), done(folder, plan.long(style))
    if not choosing or not testing:
        return None
    chosen = {key: best(curve(judged(folder, choosing, key), key)) for key in keys}
    tests = {key: judged(folder, testing, key) for key in keys}
    long_cells = {}
    quiet = judged(folder, long, OURS)
    for raise_above in sorted({chosen[OURS].raise_above, ALARM.raise_above, *SHOWN}) if long else ():
        long_cells[OURS, raise_above] = cell(quiet, OURS, raise_above)
    with_lumps = [task for task in testing if task.spec.lumps_per_minute > 0]
    return StyleResult(
        curves={key: curve(tests[key], key) for key in keys},
        chosen=chosen,
        tested={key: cell(tests[key], key, chosen[key].raise_above) for key in keys},
        choosing=_kinds(choosing),
        testing=_kinds(testing),
        long=long_cells,
        sizes=sizes(folder, with_lumps, chosen[OURS].raise_above) if with_lumps else None,
    )


def _by_all(folder: Path, plan: Plan, tasks: list[Task]) -> list[Task]:
    """The feeds that all methods have watched: only there can they be compared lump by lump."""
    return [task for task in done(folder, tasks) if task.peers == plan.peers]


def _cell(folder: Path, tasks: list[Task], key: str, raise_above: float) -> Cell:
    return cell(judged(folder, tasks, key), key, raise_above) if tasks else NOTHING


def _kinds(tasks: list[Task]) -> tuple[int, int]:
    lumps = sum(task.spec.lumps_per_minute > 0 for task in tasks)
    return lumps, len(tasks) - lumps


def _frame_ms(folder: Path, plan: Plan, tasks: list[Task]) -> dict[str, float]:
    """Of the feeds that all methods watched side by side; none: nothing."""
    medians: dict[str, list[float]] = {key: [] for key in plan.peers}
    for task in tasks:
        watched = {key: load(folder, task, key) for key in plan.peers}
        if len({one.run for one in watched.values()}) == 1:
            for key, one in watched.items():
                medians[key].append(1000.0 * float(np.median(one.frame_s[WARM_UP:])))
    return {key: float(np.median(some)) for key, some in medians.items() if some}


def total(cells: dict[str, dict[str, Cell]], key: str, keep: Callable[[str], bool] = lambda _: True) -> Cell:
    """A method over all scenes whose name is kept."""
    return sum((row[key] for name, row in cells.items() if keep(name)), NOTHING)


def axis_of(name: str) -> str:
    """What a scene changes."""
    return matrix.scene(name).axis
