"""The tracker on small scenes: wrong way, touching objects, time steps, colour, acceleration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lumpwatch.models.jdt.motion import FreeAcceleration
from lumpwatch.models.trackers.jpda import ColourOptions, OneWay
from tests.models.jpda_scenes import DT, PLAIN, SHAPE, Array, box, run, tracker


def test_wrong_way_is_flagged_and_right_way_is_not() -> None:
    subject = tracker(replace(PLAIN, one_way=OneWay((0.0, 1.0), 20.0, 0.3)))
    steps = run(subject, lambda t: np.vstack([box(100, 200 - 60 * t), box(200, 40 + 60 * t)]), 1.5)
    flags = {one.id: [] for one in steps[0]}  # type: dict[int, list[bool]]
    for step in steps:
        for one in step:
            flags[one.id].append(one.wrong_way)
    assert not any(flags[2])
    # 20 px at 60 px/s take 10 pictures; the filter's position lags by little.
    assert 9 <= flags[1].index(True) <= 12
    assert all(flags[1][12:])


def test_a_standing_target_with_jitter_is_never_flagged() -> None:
    rng = np.random.default_rng(1)
    subject = tracker(replace(PLAIN, one_way=OneWay((0.0, 1.0), 20.0, 0.1)))
    for _ in range(900):
        x, y = rng.normal(0.0, 3.0, 2)
        objects = subject.step(box(100 + x, 100 + y), DT)
        assert not any(one.wrong_way for one in objects)
    assert [one.id for one in objects if one.confirmed] == [1]


def merging(t: float) -> Array:
    """Two objects of 20 x 20 that move at 40 px/s; from 1 s to 2 s they touch and are one region."""
    gap = 10.0 + 30.0 * max(1.0 - t, t - 2.0, 0.0)
    y = 30.0 + 40.0 * t
    if gap <= 10.0:
        return box(100, y, 40, 20)
    return np.vstack([box(100 - gap, y), box(100 + gap, y)])


def test_touching_targets_keep_their_names() -> None:
    steps = run(tracker(), merging, 3.0)
    for k in (20, 45, 59, 80):
        assert {one.id for one in steps[k] if one.confirmed} == {1, 2}
        left, right = (one.box for one in sorted(steps[k], key=lambda one: one.id))
        gap = 10.0 + 30.0 * max(1.0 - k * DT, k * DT - 2.0, 0.0)
        assert left[0] == pytest.approx(100 - gap, abs=4.0)
        assert right[0] == pytest.approx(100 + gap, abs=4.0)


def test_touching_targets_stay_alive_without_cutting() -> None:
    """The one region goes to either: both live on through half a second."""
    subject = tracker(replace(PLAIN, split=False))
    steps = run(subject, merging, 1.5)
    assert {one.id for one in steps[-1] if one.confirmed} == {1, 2}


def test_two_targets_on_one_object_become_one() -> None:
    subject = tracker(replace(PLAIN, split=False))
    run(subject, lambda t: np.vstack([box(100, 100), box(130, 100)]), 1.0)
    run(subject, lambda t: np.vstack([box(100 + 15 * t, 100), box(130 - 15 * t, 100)]), 1.0)
    steps = run(subject, lambda t: box(115, 100), 3.0)
    assert [one.id for one in steps[-1]] == [1]


def test_half_the_time_step_gives_about_the_same() -> None:
    """Twice the pictures: the same position within half a pixel, the same speed and confirmation."""
    for dt in (1 / 15, 1 / 30, 1 / 60):
        steps = run(tracker(), lambda t: box(50 + 80 * t, 100 + 20 * np.sin(2 * t)), 2.0 + dt, dt)
        last = steps[-1][0]
        assert last.box[:2] == pytest.approx([210.0, 100.0 + 20.0 * np.sin(4.0)], abs=1.0)
        assert last.velocity == pytest.approx([80.0, 40.0 * np.cos(4.0)], abs=8.0)
        confirmed = next(k for k, step in enumerate(steps) if step[0].confirmed)
        assert 0.1 - 1e-9 <= confirmed * dt <= 0.1 + 1 / 15


def test_close_targets_are_not_drawn_together() -> None:
    """Two move side by side, 3 px apart, and are measured to 2 px: the plain sum sees both in the middle."""
    gaps = {}
    for association in ("jpda_star", "jpda"):
        rng = np.random.default_rng(3)
        subject = tracker(
            replace(PLAIN, split=False, association=association, birth_apart=0.0, shared_s=100.0)
        )
        kept = []
        for k in range(120):
            away = 1.5 + max(0.0, 12.0 - 0.4 * k)
            at = np.array([[100.0 - away, 30.0 + k], [100.0 + away, 30.0 + k]]) + rng.normal(0.0, 2.0, (2, 2))
            objects = {one.id: one.box for one in subject.step(np.hstack([at, np.full((2, 2), 6.0)]), DT)}
            if k >= 60:
                kept.append(abs(objects[2][0] - objects[1][0]))
        gaps[association] = float(np.mean(kept))
    assert gaps["jpda_star"] == pytest.approx(3.0, abs=1.0)
    assert gaps["jpda"] < 0.5


def test_colour_tells_two_measurements_apart() -> None:
    """A red target; a blue box lies nearer to its prediction than the red one."""
    picture = np.zeros((*SHAPE, 3), np.uint8)
    picture[:, :100], picture[:, 100:] = (0, 0, 255), (255, 0, 0)
    seen = np.vstack([box(84, 100), box(112, 100)])
    after = {}
    for weight in (0.0, 0.3):
        options = replace(PLAIN, colour=ColourOptions(weight=weight, kappa=20.0), birth_speed=150.0)
        subject = tracker(options)
        subject.step(box(89, 100), DT, picture)
        subject.step(np.vstack([box(89, 100)]), DT, picture)
        after[weight] = subject.step(seen, 0.3, picture)[0].box[0]
    assert after[0.3] < after[0.0]
    assert after[0.3] == pytest.approx(84.0, abs=2.5)


def test_a_model_with_acceleration() -> None:
    """A falling object is followed without lag by a filter that has acceleration as a state."""
    options = replace(PLAIN, model=FreeAcceleration("free", 50.0), birth_acceleration=300.0)
    steps = run(tracker(options), lambda t: box(100, 20 + 0.5 * 200 * t**2), 1.2)
    assert steps[-1][0].box[1] == pytest.approx(20 + 100 * (35 * DT) ** 2, abs=0.5)
