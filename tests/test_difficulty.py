"""Ours and its peers on the matrix of difficulty: scores, best thresholds, exact tests, plan, page, and each peer."""

from __future__ import annotations

import re
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, combinations
from pathlib import Path

import numpy as np
import pytest

from lumpwatch.models.jdt.row_profile import default_profile
from lumpwatch.models.roi import make_roi
from lumpwatch.service.offline.backtest.curve import Point, VideoRecord
from tests.offline.test_backtest import LUMP, existence, recording, track, truth
from tests.reproduction import difficulty, matrix
from tests.reproduction.difficulty import page, plots
from tests.reproduction.difficulty.judge import (
    Cell,
    best,
    cell,
    chance,
    done,
    paired,
)
from tests.reproduction.difficulty.peers import OURS, PEERS
from tests.reproduction.difficulty.plan import PARTS, STYLES, Plan, every_task
from tests.reproduction.difficulty.results import Results, StyleResult, judge_all
from tests.reproduction.difficulty.simple import BlobWatcher, MapWatcher, grid, peaks
from tests.reproduction.difficulty.sizes import Sizes, Stated, sizes
from tests.reproduction.difficulty.work import Task, learn, load, missing, prior_path, truth_boxes, watch

# Scoring: frame k is at k / 10 s; alarms rise 0.2 s after the threshold is passed and clear after 1 s below


def test_a_cell_counts_lumps_found_in_time_and_alarms_without_a_lump() -> None:
    """Raised at 3.2 s, the fall at 5.0 s: 1.8 s of warning. Above again at 8.0 s, with nobody there: false."""
    one = recording(existence((30, 50), (80, 90)), {range(30, 50): [LUMP]})
    feed = VideoRecord("feed", one, truth(one, track(20, 59, fall=50)))
    found = cell([feed, feed], OURS, 0.9)
    assert found.found == (True, True)
    assert found.warnings_s == pytest.approx((1.8, 1.8))
    assert found.false_alarms == 2
    # Quiet are the 15 frames before 1.5 s and the 35 after 6.4 s, of each feed.
    assert found.quiet_h == pytest.approx(2 * 5.0 / 3600)
    assert found.per_hour == pytest.approx(720)


def test_a_lump_announced_too_late_is_not_found() -> None:
    one = recording(existence((40, 50)), {range(40, 50): [LUMP]})
    feed = VideoRecord("feed", one, truth(one, track(20, 59, fall=50)))
    found = cell([feed], OURS, 0.9)
    assert found.found == (False,)
    assert found.warnings_s == pytest.approx((0.8,))


def test_a_method_without_memory_clears_a_little_below_its_threshold() -> None:
    threshold = MapWatcher.level(4.0)
    assert threshold == pytest.approx(0.6)
    config = PEERS["map"].alarm(threshold)
    assert (config.raise_above, config.clear_below) == pytest.approx((0.6, 0.57))
    assert PEERS[OURS].alarm(0.999).clear_below == 0.5


# The best threshold


def at(raise_above: float, announced: int, false: int, standing: float = 0.0) -> Point:
    """A threshold of a method on one quiet hour with ten lumps."""
    return Point(raise_above, 0.5, 10, announced, 3.0, 1.0, announced, 0, false, 1.0, standing)


def test_the_best_threshold_finds_most_at_the_rate_that_is_allowed() -> None:
    points = [at(0.5, 10, 9), at(0.6, 9, 6), at(0.7, 9, 4), at(0.8, 9, 4), at(0.9, 9, 4), at(0.99, 8, 0)]
    assert best(points).raise_above == 0.8  # nine lumps, with fewest false alarms, and in the middle of those


def test_an_alarm_that_never_clears_is_raised_once_and_not_chosen_for_that() -> None:
    assert best([at(0.5, 10, 1, standing=0.9), at(0.9, 7, 3)]).raise_above == 0.9


def test_a_method_that_never_keeps_to_the_rate_gets_its_quietest_threshold() -> None:
    assert best([at(0.5, 10, 90), at(0.8, 4, 20), at(0.9, 3, 20)]).raise_above == 0.9


# Exact tests


@pytest.mark.parametrize(
    ("fewer", "more", "expected"), [(0, 5, 1 / 32), (0, 0, 1.0), (3, 1, 15 / 16), (1, 2, 0.5)]
)
def test_chance_is_that_of_a_fair_coin(fewer: int, more: int, expected: float) -> None:
    assert chance(fewer, more) == pytest.approx(expected)


def some(found: int, of: int = 16, false: int = 0) -> Cell:
    """The first `found` lumps of some."""
    marks = tuple(k < found for k in range(of))
    return Cell(marks, tuple(2.0 * mark for mark in marks), false, 0.5)


def test_five_lumps_are_a_difference_and_four_are_none() -> None:
    assert not paired(some(12), some(16)).fewer_found  # 1 / 16
    assert paired(some(11), some(16)).fewer_found  # 1 / 32
    assert not paired(some(16), some(11)).fewer_found
    assert not paired(some(8, false=4), some(8)).more_false
    assert paired(some(8, false=5), some(8)).more_false


def test_lumps_are_compared_one_by_one() -> None:
    ours, theirs = Cell((True, False, True), (), 0, 1.0), Cell((False, True, True), (), 0, 1.0)
    one = paired(ours, theirs)
    assert (one.only_ours, one.only_theirs) == (1, 1)


# The methods that follow nothing


def test_the_grid_has_boxes_of_all_sizes_of_a_row_close_to_any_place() -> None:
    roi = make_roi([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], 120, 90, 120)
    boxes = grid(default_profile(90.0, 20.0, 40.0, 50.0), roi, shifts=8, sizes=(-1.0, 0.0, 1.0))
    middle = np.sqrt(20.0 * 40.0)
    assert sorted(set(boxes[:, 6].round(3))) == pytest.approx(
        [middle * 2**-0.25, middle, middle * 2**0.25], abs=1e-3
    )
    rng = np.random.default_rng(1)
    for x, y in rng.uniform((0, 0), (119, 89), (50, 2)):
        assert np.abs(boxes[:, :2] - (x, y)).max(axis=1).min() <= middle * 2**0.25 / 8


def test_peaks_do_not_overlap_and_only_the_first_may_be_below_zero() -> None:
    boxes = np.array([[10.0, 10, 8, 8], [12, 10, 8, 8], [40, 10, 8, 8], [70, 10, 8, 8]])
    assert peaks(boxes, np.array([5.0, 6.0, 1.0, -1.0]), 3).tolist() == [1, 2]
    assert peaks(boxes, np.array([-3.0, -2.0, -4.0, -5.0]), 3).tolist() == [1]
    assert peaks(boxes, np.full(4, -np.inf), 3).tolist() == []


def test_levels_keep_the_order_of_what_they_stand_for() -> None:
    for level, values in ((MapWatcher.level, (-6.0, 0.0, 18.0)), (BlobWatcher.level, (0.3, 1.0, 1.95))):
        levels = [level(value) for value in values]
        assert levels == sorted(set(levels))
        assert 0.0 < levels[0] < levels[-1] < 1.0


# The plan


def test_no_seed_serves_two_purposes() -> None:
    plan = Plan(long_feeds=30)
    for style in STYLES:
        scene = plan.standard(style)
        trained = {next(scene.train()).seed}
        parts = [plan.choosing(style), plan.testing(scene), *(plan.long(one) for one in STYLES)]
        seeds = [trained, *({task.spec.seed for task in part} for part in parts)]
        assert all(seeds)
        assert all(not a & b for a, b in combinations(seeds, 2))


def test_the_plan_holds_what_was_promised_and_the_standard_scenes_come_first() -> None:
    plan = Plan()
    tasks = list(every_task(plan, PARTS))
    assert len({task.name for task in tasks}) == len(tasks)
    assert {task.scene for task in tasks[: len(plan.tasks("curves"))]} == {"standard", "b-standard"}
    assert {task.scene for task in tasks} == {scene.name for scene in matrix.scenes()}
    long = list(chain.from_iterable(plan.long(style) for style in STYLES))
    assert sum(task.seconds for task in long) >= 5 * 3600
    assert all(task.spec.lumps_per_minute == 0 for task in long)
    standard = [plan.with_lumps(plan.standard(style)) for style in STYLES]
    assert [sum(OURS in task.peers for task in some) for some in standard] == [20, 20]
    assert [sum("jpda" in task.peers for task in some) for some in standard] == [4, 4]


def test_nothing_begins_after_the_deadline(tmp_path: Path) -> None:
    task = Task("standard", matrix.STANDARD, 10.0, (OURS,))
    for style in STYLES:
        for key in PEERS:
            prior_path(tmp_path, style, key).touch()
    with ThreadPoolExecutor(1) as pool:
        difficulty.run(tmp_path, [task], time.monotonic() - 1.0, pool)
    assert missing(tmp_path, task) == (OURS,)


def test_results_of_two_codes_are_not_mixed(tmp_path: Path) -> None:
    """The feed that was being watched when the code changed is the last one."""
    watched: list[str] = []

    def look(folder: Path, task: Task) -> float:
        watched.append(task.name)
        return 1.0

    tasks = Plan().choosing("a")[:3]
    with ThreadPoolExecutor(1) as pool, pytest.raises(SystemExit, match="the code changed"):
        difficulty.run(
            tmp_path,
            tasks,
            None,
            pool,
            lambda: len(watched) < 2,
            workers=1,
            teach=lambda folder, style: None,
            watch=look,
        )
    assert watched == [task.name for task in tasks[:2]]


# Sizes and the page


def test_sizes_are_judged_where_they_are_stated() -> None:
    one = Stated(
        np.array([800.0, 1000.0, 900.0]),
        np.array([880.0, 900.0, np.nan]),
        np.array([700.0, 700.0, np.nan]),
        np.array([1000.0, 950.0, np.nan]),
    )
    assert one.errors.tolist() == pytest.approx([0.1, -0.1])
    assert one.held == 1


def results(cells: dict[str, dict[str, Cell]]) -> Results:
    """What a run might have given."""
    keys = tuple(PEERS)
    stated = Stated(np.array([800.0]), np.array([840.0]), np.array([700.0]), np.array([990.0]))
    style = StyleResult(
        curves={key: [at(0.5, 10, 3), at(0.9, 9, 0)] for key in keys},
        chosen={key: at(0.9, 9, 0) for key in keys},
        tested={key: some(15) for key in keys},
        choosing=(2, 3),
        testing=(4, 5),
        long={(OURS, 0.9): Cell((), (), 1, 5.0)},
        sizes=Sizes(stated, stated),
    )
    feeds = dict.fromkeys(cells, (1, 1))
    return Results(Plan(), {"a": style}, cells, feeds, dict.fromkeys(PEERS, 2.0))


def test_the_page_says_where_a_peer_is_better(tmp_path: Path) -> None:
    level = dict.fromkeys(PEERS, some(14))
    found = results(
        {
            "standard": level,
            "dust-1": {**level, "jpda": some(15)},
            "night-1": {**level, OURS: some(8), "mog2": some(16, false=7)},
            "rain-storm": {**level, OURS: some(14, false=9), "jpda": some(2)},
        }
    )
    text = page.write(found)
    surely, perhaps = text.split("explains it, at:")
    surely, traded = surely.split("at the price of")
    assert "- rain-storm, JPDA: 2 against 14 of 16 lumps, 0 against 9 false alarms" in traded
    assert "- rain-storm, MOG2 and blob size: 14 against 14 of 16 lumps, 0 against 9 false alarms" in surely
    assert "- night-1, MOG2 and blob size: 16 against 8 of 16 lumps, 7 against 0 false alarms" in surely
    assert "- dust-1, JPDA: 15 against 14 of 16 lumps" in perhaps
    assert "5 h" not in text
    assert re.search(
        r"\| a \| 0\.9 \(chosen, default\) \| 5\.0 \| 1 \| 0\.20 \| 0\.01 to 1\.11 \| 9 of 10 \|", text
    )
    assert "| a | alarm | 1 | 1 | 5.0% | +5.0% |" in text
    plots.draw(found, tmp_path)
    for name in re.findall(r"images/([\w-]+\.png)", text):
        assert (tmp_path / name).stat().st_size > 5_000


def test_the_page_says_so_where_ours_is_behind_nobody_and_what_was_not_run() -> None:
    level = dict.fromkeys(PEERS, some(14))
    assert "**At no scene does a peer" in page.write(results({"standard": level}))
    empty = page.write(Results(Plan(), {}, {}, {}, {}))
    assert empty.count("*Not run yet.*") == 6


# Everything together, short


@pytest.mark.slow
def test_every_peer_watches_a_feed_and_what_it_said_is_kept(tmp_path: Path) -> None:
    learn(tmp_path, "a", seconds=24.0)
    plan = Plan(
        choose_lumps=1, choose_empty=0, test_lumps=1, test_empty=0, long_feeds=0, scenes=("standard",), seconds=6.0
    )  # fmt: skip
    scene = matrix.scene("standard")
    (task,) = plan.testing(scene)
    assert missing(tmp_path, task) == tuple(PEERS)
    watch(tmp_path, task)
    assert done(tmp_path, [task]) == [task]
    boxes, true_mm = truth_boxes(tmp_path, task)
    assert boxes
    assert set(true_mm) == {box.track for box in boxes}
    for key in PEERS:
        watched = load(tmp_path, task, key)
        assert watched.recording.length == 90
        assert np.all((watched.recording.alarming >= 0) & (watched.recording.alarming <= 1))
        assert np.isfinite(watched.recording.boxes).all()
        assert np.all(watched.frame_s > 0)
    # Whether a lump is found in so short a time is no matter here; a map always has a maximum.
    assert set(load(tmp_path, task, "map").recording.owner) == set(range(90))
    assert np.ptp(load(tmp_path, task, OURS).recording.alarming) > 0
    assert len({load(tmp_path, task, key).run for key in PEERS}) == 1
    sizes(tmp_path, [task], 0.9)
    # What is there is not watched again, and a method that is not there is.
    (gone,) = tmp_path.glob("*.mog2.npz")
    gone.unlink()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz") if "truth" not in path.name}
    watch(tmp_path, task)
    assert load(tmp_path, task, "mog2").run != load(tmp_path, task, OURS).run
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())
    assert "a" not in judge_all(tmp_path, plan).styles  # its training feed was not watched
