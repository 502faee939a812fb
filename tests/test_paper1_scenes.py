"""The scenes of the paper's experiments, and what is measured of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lumpwatch.models.learning import LumpFit
from lumpwatch.models.roi import make_roi
from lumpwatch.models.state import States, X, blank
from tests.reproduction.paper1 import footage, page
from tests.reproduction.paper1.experiments import EXPERIMENTS, LUMP, NOISY_SQUARE, SLIDE
from tests.reproduction.paper1.footage import REAL_FPS, REAL_TRAINING, football, football_folder
from tests.reproduction.paper1.measure import Measures, Run, after_switch, measure
from tests.reproduction.paper1.methods import Motions, learn, learn_all_motions, make_filter
from tests.reproduction.paper1.scenes import (
    FOOT_ROW,
    SQUARE_SHAPE,
    SQUARE_SIZE,
    TABLE_ROW,
    WHOLE,
    Scene,
    bouncing_square,
    juggling,
    slide,
    table_tennis,
)

SCENES: dict[str, Callable[[int], Scene]] = {
    "square": partial(bouncing_square, noise=8.0),
    "ping-pong": partial(table_tennis, noise=8.0),
    "juggling": partial(juggling, noise=8.0),
    "slide": partial(slide, noise=8.0),
}


@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES.keys())
def test_seed_decides_every_pixel(make: Callable[[int], Scene]) -> None:
    one, same, other = make(3), make(3), make(4)
    assert all(np.array_equal(a, b) for a, b in zip(one.pictures, same.pictures, strict=True))
    assert np.array_equal(one.boxes, same.boxes, equal_nan=True)
    assert not np.array_equal(one.pictures[30], other.pictures[30])


@pytest.mark.parametrize("make", SCENES.values(), ids=SCENES.keys())
def test_object_comes_once_stays_in_the_picture_and_goes(make: Callable[[int], Scene]) -> None:
    scene = make(5)
    there = np.flatnonzero(scene.present)
    assert there[0] > 0
    assert there[-1] < len(scene.pictures) - 1
    assert np.all(np.diff(there) == 1)
    assert np.all(scene.labels[there] >= 0)
    assert np.all(scene.labels[~scene.present] == -1)
    h, w = scene.pictures[0].shape
    assert np.all((scene.boxes[there, :2] >= 0) & (scene.boxes[there, :2] <= (w, h)))


def test_square_is_where_the_box_says() -> None:
    scene = bouncing_square(0, noise=0.0)
    frame = int(np.flatnonzero(scene.present)[7])
    changed = np.flatnonzero(np.any(scene.pictures[frame] != scene.pictures[0], axis=0))
    left = scene.boxes[frame, 0] - SQUARE_SIZE / 2
    assert abs(changed[0] - left) <= 1.0
    assert abs(changed[-1] + 1 - (left + SQUARE_SIZE)) <= 1.0


def test_square_crosses_in_about_ten_frames_and_bounces_at_the_borders() -> None:
    scene = bouncing_square(1, noise=8.0, frames=400)
    bounces = np.flatnonzero(scene.labels == 1)
    assert 7 <= np.median(np.diff(bounces)) <= 10
    velocity = np.diff(scene.boxes[:, 0])
    for k in bounces[1:]:
        assert velocity[k - 1] * velocity[k - 2] < 0  # the step that led to frame k, and the one before
    before = scene.boxes[bounces - 1, 0]
    middle = SQUARE_SHAPE[1] / 2
    assert np.all(np.abs(before - middle) > 0.3 * SQUARE_SHAPE[1])


def test_ball_bounces_on_the_table_and_returns_at_the_bats() -> None:
    scene = table_tennis(2, noise=8.0)
    assert {0, 1, 2} <= set(scene.labels.tolist())
    assert np.all(np.abs(scene.boxes[scene.labels == 1, 1] - TABLE_ROW) < 15.0)
    vx = np.diff(scene.boxes[:, 0])
    signs = np.sign(vx[scene.present[1:] & scene.present[:-1]])
    returns = int((scene.labels == 2).sum())
    assert int((signs[1:] != signs[:-1]).sum()) == returns


def test_football_falls_with_constant_acceleration_between_kicks() -> None:
    scene = juggling(2, noise=8.0)
    there = np.flatnonzero(scene.present)
    y, kicked = scene.boxes[there, 1], scene.labels[there] == 1
    # Three steps without a kick: the second difference is the acceleration, up to the jitter of 0.3 px.
    free = ~(kicked[2:] | kicked[1:-1])
    assert np.median(np.diff(y, 2)[free]) == pytest.approx(1.4, abs=0.15)
    assert np.all(y[kicked] < FOOT_ROW)


def test_slider_accelerates_and_then_wanders() -> None:
    scene = slide(3, noise=8.0)
    there = np.flatnonzero(scene.present)
    assert len(there) == 28
    labels = scene.labels[there]
    assert np.all(np.diff(labels) >= 0)
    speed = np.linalg.norm(np.diff(scene.boxes[there, :2], axis=0), axis=1)
    slides = labels[1:] == 0
    assert np.polyfit(np.flatnonzero(slides), speed[slides], 1)[0] == pytest.approx(0.75, abs=0.15)


def test_feed_shows_one_lump_on_the_belt_and_then_falling() -> None:
    scene = footage.feed(0, noise=5.0)
    there = np.flatnonzero(scene.present)
    labels = scene.labels[there]
    assert there[0] == footage.FEED_MARGIN
    assert len(scene.pictures) - 1 - there[-1] == footage.FEED_MARGIN
    assert set(labels.tolist()) == {0, 1}
    assert np.all(np.diff(labels) >= 0)
    assert np.all(np.diff(scene.boxes[there, 1]) > 0)


def test_footage_is_looked_for_where_the_environment_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LUMPWATCH_FOOTAGE", str(tmp_path))
    assert football_folder() is None
    with pytest.raises(FileNotFoundError, match="footage"):
        football(0, 10.0, training=True)
    folder = tmp_path / "soccer-juggling"
    folder.mkdir()
    (folder / "juggling.mp4").touch()
    assert football_folder() is None
    (folder / "gt.txt").touch()
    assert football_folder() == folder


@pytest.mark.slow
@pytest.mark.footage
@pytest.mark.skipif(football_folder() is None, reason="the football footage is not here")
def test_football_halves_share_no_frame() -> None:
    training, test = (football(0, 0.0, training=half, empty=(2, 2)) for half in (True, False))
    assert training.present.sum() == REAL_TRAINING
    assert test.present.sum() == 125
    assert training.interval_s == 1 / REAL_FPS
    assert not np.array_equal(training.boxes[2], test.boxes[2])


def _run_and_scene() -> tuple[Run, Scene]:
    boxes = np.full((24, 4), np.nan)
    boxes[2:22] = (50.0, 40.0, 20.0, 10.0)
    labels = np.full(24, -1)
    labels[2:22] = 0
    labels[10] = 1
    pictures = tuple(np.zeros((80, 100), np.uint8) for _ in boxes)
    existence = np.zeros(24)
    existence[0] = 0.9  # one false alarm among four empty frames
    existence[6:22] = 0.9  # found on the fifth of twenty frames
    centres = np.full((24, 2), (53.0, 44.0))
    centres[12] = (80.0, 40.0)  # beside the box
    return Run(existence, centres), Scene(pictures, boxes, labels, 0.1)


def test_measures_of_a_run_worked_by_hand() -> None:
    result, scene = _run_and_scene()
    found = measure(result, scene, make_roi(WHOLE, 100, 80, 100))
    assert found.detected == pytest.approx(16 / 20)
    assert found.detected_late == pytest.approx(1.0)
    assert found.false_alarms == pytest.approx(1 / 4)
    assert found.first == 4.0
    assert found.error == pytest.approx(5.0)
    assert found.after_switch == pytest.approx(4 / 5)


def test_nothing_found_leaves_no_first_detection_and_no_error() -> None:
    result, scene = _run_and_scene()
    found = measure(replace(result, existence=np.zeros(24)), scene, make_roi(WHOLE, 100, 80, 100))
    assert found.detected == found.false_alarms == 0.0
    assert np.isnan(found.first)
    assert np.isnan(found.error)


def test_a_bounce_is_one_change() -> None:
    _, scene = _run_and_scene()
    assert np.flatnonzero(after_switch(scene)).tolist() == [10, 11, 12, 13, 14]


def test_state_first_pairs_a_state_with_the_label_of_the_step_after() -> None:
    experiment = replace(NOISY_SQUARE, training_seeds=(1000, 1001))
    knowledge = learn(experiment, [experiment.for_training(seed) for seed in experiment.training_seeds])
    at_once, shifted, *_ = learn_all_motions(experiment, knowledge)
    assert np.array_equal(at_once.matrix, shifted.matrix)
    # The square bounces within a step of the border; one step earlier it was a crossing's tenth inside.
    border, inside = blank(1), blank(1)
    border[0, X], inside[0, X] = 148.0, 134.0

    def bounce_share(motions: Motions, states: States) -> float:
        density = motions.densities.at(states)[0]
        return float(density[1] / density.sum())

    assert bounce_share(at_once, border) > bounce_share(at_once, inside)
    assert bounce_share(shifted, inside) > bounce_share(at_once, inside)


def test_every_method_differs_in_its_configuration_only() -> None:
    knowledge = learn(SLIDE, [SLIDE.for_training(seed) for seed in (1000, 1001, 1002)])
    motions = learn_all_motions(SLIDE, knowledge)
    filters = [
        make_filter(SLIDE, method, knowledge, learned, 1.0)
        for method, learned in zip(SLIDE.methods, motions, strict=True)
    ]
    assert len({jdt.particles for jdt in filters}) == 1
    assert len({jdt.chain for jdt in filters}) == 1
    assert all(jdt.profile is filters[0].profile for jdt in filters)
    assert [len(jdt.models) for jdt in filters] == [2, 2, 2, 2, 1, 1, 1]


def test_training_and_test_seeds_are_apart_and_enough() -> None:
    for experiment in EXPERIMENTS:
        assert len(set(experiment.test_seeds)) >= 20
        assert not set(experiment.test_seeds) & set(experiment.training_seeds)


def test_verdict_needs_the_interval_to_leave_out_zero() -> None:
    assert page.difference(np.array([2.0, 3.0, 4.0]), np.zeros(3)).verdict == "better"
    assert page.difference(np.zeros(3), np.array([2.0, 3.0, 4.0])).verdict == "worse"
    assert page.difference(np.array([-1.0, 0.0, 2.0]), np.zeros(3)).verdict == "no difference"
    assert page.difference(np.array([np.nan, 1.0]), np.zeros(2)).verdict == "no difference"


def test_cells_show_median_and_quartiles() -> None:
    assert page.spread(np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan]), 1) == "3.0 (2.0-4.0)"
    assert page.spread(np.array([np.nan]), 1) == "-"


def test_measures_have_a_column_each() -> None:
    assert len(page._COLUMNS) == len(Measures.__dataclass_fields__)


@pytest.mark.slow
def test_the_large_lump_is_learned_with_the_likelihood_of_the_service() -> None:
    knowledge = learn(LUMP, [LUMP.for_training(seed) for seed in LUMP.training_seeds[:2]])
    assert isinstance(knowledge.appearance, LumpFit)
    assert np.isfinite(knowledge.appearance.offset)
