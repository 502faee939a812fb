"""Labels and parameters of motion models from tracks whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.learning import Samples, Track, fit_motion, samples
from lumpwatch.models.learning.motion import ModelSpec
from lumpwatch.models.state import AX, AY, VX, VY
from tests.models.helpers import boxes as still_boxes
from tests.models.helpers import moving_track

Array = NDArray[np.float64]
Labels = NDArray[np.intp]
DT = 0.04
BELT, FALL = np.array([0.0, 30.0]), np.array([5.0, 300.0])


def belt_then_fall(rng: np.random.Generator, pixel_noise: float) -> tuple[Track, Labels]:
    """An object on the belt for some 50 frames, then falling for some 20, and its true label a frame."""
    n_belt, n_fall = int(rng.integers(40, 60)), int(rng.integers(15, 25))
    labels = np.repeat([0, 1], [n_belt, n_fall])
    accelerations = np.where(labels[:, None] == 0, BELT, FALL)
    velocity = np.array([0.0, 25.0]) + DT * np.vstack([np.zeros(2), np.cumsum(accelerations, axis=0)])
    steps = velocity[:-1] * DT + 0.5 * accelerations * DT**2
    boxes = moving_track((80.0, 10.0), steps)
    boxes[:, :2] += pixel_noise * rng.standard_normal((len(boxes), 2))
    return Track(np.arange(len(boxes)), boxes), labels


def belt_and_fall(seed: int) -> tuple[Samples, Labels]:
    """Ten such objects with a fifth of a pixel of noise, smoothed over seven frames."""
    rng = np.random.default_rng(seed)
    tracks, labels = zip(*[belt_then_fall(rng, 0.2) for _ in range(10)], strict=True)
    return samples(tracks, DT, 3), np.concatenate(labels)


OPEN = (ModelSpec("rate"), ModelSpec("rate"))


@pytest.mark.parametrize("seed", range(5))
def test_belt_then_fall(seed: int) -> None:
    steps, truth = belt_and_fall(seed)
    fit = fit_motion(steps, OPEN, least_spread=0.5)
    assert np.mean(fit.labels == truth) >= 0.95
    assert fit.rates[0, 1] == pytest.approx(BELT[1], rel=0.15)
    assert fit.rates[1, 1] == pytest.approx(FALL[1], rel=0.15)
    assert np.abs(fit.rates[:, 0] - [0.0, 5.0]).max() < 10.0


def test_switch_is_found_within_the_smoothing() -> None:
    """Each track has one switch, and not more than the seven frames of smoothing away from the true one."""
    steps, truth = belt_and_fall(7)
    labels = fit_motion(steps, OPEN, least_spread=0.5).labels
    for rows in np.split(np.arange(len(truth)), np.flatnonzero(steps.starts)[1:]):
        found = np.flatnonzero(np.diff(labels[rows]))
        assert len(found) == 1
        assert abs(found[0] - np.flatnonzero(np.diff(truth[rows]))[0]) <= 7


def test_given_rate_is_kept() -> None:
    steps, truth = belt_and_fall(1)
    fit = fit_motion(steps, (ModelSpec("rate", (0.0, 250.0)), ModelSpec("rate")), least_spread=0.5)
    assert np.array_equal(fit.rates[0], [0.0, 250.0])
    assert fit.rates[1, 1] == pytest.approx(BELT[1], rel=0.15)
    assert np.mean(fit.labels == 1 - truth) >= 0.9


def test_one_model_takes_all_steps() -> None:
    """Without noise the rate of a single fall is exact."""
    t = DT * np.arange(20)[:, None]
    centre = np.array([80.0, 10.0]) + np.array([3.0, 25.0]) * t + 0.5 * FALL * t**2
    track = Track(np.arange(20), np.hstack([centre, np.full((20, 2), 20.0)]))
    fit = fit_motion(samples([track], DT, 3), (ModelSpec("rate"),), least_spread=0.5)
    assert np.all(fit.labels == 0)
    assert fit.rates[0] == pytest.approx(FALL, rel=1e-6)
    assert fit.spreads[0] == 0.5


def test_given_labels_are_kept() -> None:
    """Also where they are the wrong way round, and next to steps whose label is open."""
    steps, truth = belt_and_fall(3)
    rng = np.random.default_rng(0)
    given = np.where(rng.random(len(truth)) < 0.3, rng.integers(0, 2, len(truth)), -1)
    told = Samples(steps.states, steps.velocity, given, steps.starts, steps.interval_s)
    labels = fit_motion(told, OPEN, least_spread=0.5).labels
    assert np.array_equal(labels[given >= 0], given[given >= 0])


def test_all_labels_given_are_the_labels() -> None:
    steps, truth = belt_and_fall(4)
    told = Samples(steps.states, steps.velocity, truth, steps.starts, steps.interval_s)
    fit = fit_motion(told, OPEN, least_spread=0.5)
    assert np.array_equal(fit.labels, truth)
    assert fit.rates[1, 1] == pytest.approx(FALL[1], rel=0.15)


def bouncing(axes: Sequence[str | None], speed: tuple[float, float], noise: float, seed: int) -> Samples:
    """A track at constant velocity whose velocity is turned at the frames that name an axis."""
    velocity, steps = np.array(speed), []
    for axis in axes:
        if axis is not None:
            velocity = velocity * {"x": (-1, 1), "y": (1, -1), "both": (-1, -1)}[axis]
        steps.append(velocity * 0.1)
    boxes = moving_track((50.0, 50.0), np.array(steps))
    boxes[:, :2] += noise * np.random.default_rng(seed).standard_normal((len(boxes), 2))
    return samples([Track(np.arange(len(boxes)), boxes)], 0.1, 0)


@pytest.mark.parametrize("seed", range(5))
def test_bounces_on_one_axis(seed: int) -> None:
    """The paper's square: ten frames to one side, a bounce, ten frames back; 40 px/s and 0.2 px of noise."""
    axes = ["x" if t and t % 10 == 0 else None for t in range(100)]
    fit = fit_motion(
        bouncing(axes, (40.0, 0.0), 0.2, seed), (ModelSpec("velocity"), ModelSpec("bounce_x")), 1.0
    )
    # The first step has no velocity before it and is left out.
    assert np.array_equal(fit.labels, [int(axis == "x") for axis in axes[1:]])
    assert np.array_equal(fit.rates, np.zeros((2, 2)))


def test_bounces_on_every_axis() -> None:
    names = [None, "x", "y", "both"]
    axes = [names[t // 7 % 4] if t and t % 7 == 0 else None for t in range(120)]
    specs = [ModelSpec("velocity"), ModelSpec("bounce_x"), ModelSpec("bounce_y"), ModelSpec("bounce")]
    fit = fit_motion(bouncing(axes, (40.0, 30.0), 0.1, 0), specs, 1.0)
    assert np.array_equal(fit.labels, [names.index(axis) for axis in axes[1:]])


def test_standing_then_moving() -> None:
    """At rest with a little noise, then at 60 px/s."""
    steps = np.repeat([[0.0, 0.0], [6.0, 0.0]], [40, 40], axis=0)
    boxes = moving_track((10.0, 10.0), steps)
    boxes[:, :2] += 0.05 * np.random.default_rng(0).standard_normal((len(boxes), 2))
    track = Track(np.arange(len(boxes)), boxes)
    fit = fit_motion(samples([track], 0.1, 0), (ModelSpec("still"), ModelSpec("velocity")), 1.0)
    # The step at which it starts fits neither law; the others are plain.
    truth = (np.arange(1, 80) >= 40).astype(int)
    wrong = np.flatnonzero(fit.labels != truth) + 1
    assert set(wrong) <= {40}


def steps_of(velocities: Sequence[float], interval: float) -> Samples:
    """One track with the given velocities along y."""
    n = len(velocities) - 1
    states, after = still_boxes(n), np.zeros((n, 2))
    states[:, VY], after[:, 1] = velocities[:-1], velocities[1:]
    return Samples(states, after, np.full(n, -1), np.arange(n) == 0, interval)


def test_lone_doubtful_step_is_no_switch() -> None:
    """Rates of 0 and 100 px/s^2 at 25 frames/s, spread 2 px/s. One step at 55 px/s^2 misses the first by
    2.2 and the second by 1.8 px/s: 0.2 in log, against 2 log(0.95 / 0.05) = 5.9 for there and back. Five
    such steps at 100 px/s^2 in a row are 10 for and 5.9 against."""
    specs = (ModelSpec("rate", (0.0, 0.0)), ModelSpec("rate", (0.0, 100.0)))
    doubtful = [0.0] * 10 + [2.2] * 10
    assert np.all(fit_motion(steps_of(doubtful, DT), specs, least_spread=2.0).labels == 0)
    plain = [0.0] * 10 + [4.0, 8.0, 12.0, 16.0, 20.0] + [20.0] * 10
    labels = fit_motion(steps_of(plain, DT), specs, least_spread=2.0).labels
    assert np.array_equal(np.flatnonzero(labels), np.arange(9, 14))


def test_after_a_bounce_comes_another_model() -> None:
    """From 40 to -40 px/s is a bounce. The next step, to 5, misses going on by 45 and another bounce by 35:
    1 in log at a spread of 20, which does not make up for two bounces in a row."""
    specs = (ModelSpec("velocity"), ModelSpec("bounce_y"))
    fit = fit_motion(steps_of([40.0] * 6 + [-40.0] + [5.0] * 6, 0.1), specs, least_spread=20.0)
    assert np.array_equal(np.flatnonzero(fit.labels), [5])


def test_spread_of_the_residual() -> None:
    """v' = v + 5 w over 4000 steps: the spread is 5 within five standard errors of 5 / sqrt(2 * 4000)."""
    rng = np.random.default_rng(0)
    n = 4000
    velocity = np.cumsum(5.0 * rng.standard_normal((n + 1, 2)), axis=0)
    states = still_boxes(n)
    states[:, [VX, VY]] = velocity[:-1]
    steps = Samples(states, velocity[1:], np.full(n, -1), np.arange(n) == 0, DT)
    fit = fit_motion(steps, (ModelSpec("velocity"),), least_spread=0.1)
    assert fit.spreads[0] == pytest.approx(5.0, abs=5 * 5 / np.sqrt(2 * n))


def test_free_acceleration_predicts_by_the_state() -> None:
    """Velocity changes by the state's own acceleration: nothing is left but the floor."""
    rng = np.random.default_rng(1)
    states = still_boxes(50)
    states[:, [AX, AY]] = 100 * rng.standard_normal((50, 2))
    steps = Samples(states, states[:, [AX, AY]] * DT, np.full(50, -1), np.arange(50) == 0, DT)
    fit = fit_motion(steps, (ModelSpec("velocity"), ModelSpec("free")), least_spread=0.3)
    assert np.all(fit.labels == 1)
    assert fit.spreads[1] == 0.3


def test_spread_has_a_floor() -> None:
    """A noiseless track; and a model that never occurs has the floor too."""
    steps = bouncing([None] * 30, (40.0, 0.0), 0.0, 0)
    fit = fit_motion(steps, (ModelSpec("velocity"), ModelSpec("bounce_x")), least_spread=2.5)
    assert np.array_equal(fit.spreads, [2.5, 2.5])
    assert np.all(fit.labels == 0)


def test_only_bounces_are_momentary() -> None:
    assert all(ModelSpec(law).momentary for law in ("bounce_x", "bounce_y", "bounce"))
    assert not any(ModelSpec(law).momentary for law in ("still", "walk", "velocity", "rate", "free"))
