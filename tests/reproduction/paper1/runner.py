"""Plays an experiment: learning, the choice of each method's noise level, and the test runs."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np

from tests.reproduction.paper1.measure import Measures, Run, measure, run
from tests.reproduction.paper1.methods import (
    Experiment,
    Knowledge,
    Method,
    Motions,
    label_prediction,
    labelled_views,
    learn,
    learn_all_motions,
    make_filter,
    make_likelihood,
)
from tests.reproduction.paper1.scenes import Scene


@dataclass(frozen=True, slots=True)
class Prepared:
    """An experiment after learning; what a worker needs."""

    experiment: Experiment
    knowledge: Knowledge
    motions: tuple[Motions, ...]
    """Of each method."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One method over the test seeds."""

    method: Method
    level: float
    """The chosen noise level."""
    scores: tuple[float, ...]
    """Mean of detected less false alarms over the training seeds, for each level."""
    measures: tuple[Measures, ...]
    """Of each test seed."""
    shown: Run
    """The run on the first test seed."""


@dataclass(frozen=True, slots=True)
class Result:
    """One experiment, played."""

    prepared: Prepared
    scene: Scene
    """Test scene of the first seed."""
    outcomes: tuple[Outcome, ...]
    prediction: tuple[float, float]
    """Mean log probability of the next model on the test scenes by Eq. 12 and by Eq. 10."""


def initialise() -> None:
    """A worker's share of the machine is one core."""
    cv2.setNumThreads(1)


def play(experiment: Experiment, pool: Executor) -> Result:
    """Learn on the training scenes, choose levels there, and run on the test scenes."""
    prepared = prepare(experiment)
    methods, levels = experiment.methods, experiment.levels
    every = [list(levels) for _ in methods]
    tried = list(pool.map(_trial, *_tasks(prepared, experiment.training_seeds, True, every)))
    # (seeds, methods, levels)
    net = np.array([[[m.detected - m.false_alarms for m, _ in row] for row in trial] for trial in tried])
    scores = net.mean(axis=0)
    chosen = [levels[int(best)] for best in scores.argmax(axis=1)]
    tested = list(
        pool.map(_trial, *_tasks(prepared, experiment.test_seeds, False, [[level] for level in chosen]))
    )
    outcomes = tuple(
        Outcome(
            method,
            chosen[m],
            tuple(float(score) for score in scores[m]),
            tuple(trial[m][0][0] for trial in tested),
            tested[0][m][0][1],
        )
        for m, method in enumerate(methods)
    )
    scenes = [experiment.scene(seed) for seed in experiment.test_seeds]
    prediction = label_prediction(experiment, prepared.knowledge, prepared.motions[0], scenes)
    return Result(prepared, scenes[0], outcomes, prediction)


def prepare(experiment: Experiment) -> Prepared:
    """Learn what all methods share, and each method's motion."""
    scenes = [experiment.for_training(seed) for seed in experiment.training_seeds]
    knowledge = learn(experiment, scenes)
    return Prepared(experiment, knowledge, learn_all_motions(experiment, knowledge))


def _tasks(
    prepared: Prepared, seeds: Sequence[int], training: bool, levels: list[list[float]]
) -> tuple[list[Prepared], list[int], list[bool], list[list[list[float]]]]:
    n = len(seeds)
    return [prepared] * n, list(seeds), [training] * n, [levels] * n


def _trial(
    prepared: Prepared, seed: int, training: bool, levels: list[list[float]]
) -> list[list[tuple[Measures, Run]]]:
    """All methods, each at some levels, on the scene of one seed."""
    experiment, knowledge = prepared.experiment, prepared.knowledge
    scene = experiment.for_training(seed) if training else experiment.scene(seed)
    likelihood = make_likelihood(experiment, knowledge.appearance)
    views = [item.view for item in labelled_views(scene, knowledge.roi, most=len(scene.pictures))]
    found = []
    for method, motions, some in zip(experiment.methods, prepared.motions, levels, strict=True):
        row = []
        for level in some:
            jdt = make_filter(experiment, method, knowledge, motions, level)
            result = run(jdt, likelihood, views, scene.interval_s, seed)
            row.append((measure(result, scene, knowledge.roi), result))
        found.append(row)
    return found
