"""From labelled tracks to training steps: kinematics, labels, gaps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.learning import Track, samples
from lumpwatch.models.learning.tracks import split_at_gaps
from lumpwatch.models.state import AX, AY, VX, VY, H, W, X, Y

Array = NDArray[np.float64]
DT = 0.04
VELOCITY, ACCELERATION = np.array([12.0, -30.0]), np.array([-40.0, 250.0])


def parabola(frames: int) -> tuple[Array, Array]:
    """Boxes of an object at constant acceleration, and its true velocity, at each frame."""
    t = DT * np.arange(frames)[:, None]
    centre = np.array([100.0, 60.0]) + VELOCITY * t + 0.5 * ACCELERATION * t**2
    size = np.column_stack([20.0 + np.arange(frames), 30.0 - np.arange(frames) / 10])
    return np.hstack([centre, size]), VELOCITY + ACCELERATION * t


def track(boxes: Array, first: int = 1, labels: list[int] | None = None) -> Track:
    frames = np.arange(first, first + len(boxes))
    return Track(frames, boxes, None if labels is None else np.array(labels))


def test_parabola_is_recovered_exactly_at_every_frame() -> None:
    boxes, velocity = parabola(12)
    for half_window in (2, 3, 20):
        steps = samples([track(boxes)], DT, half_window)
        assert len(steps.states) == 11
        assert steps.states[:, [X, Y]] == pytest.approx(boxes[:-1, :2], abs=1e-7)
        assert steps.states[:, [VX, VY]] == pytest.approx(velocity[:-1], abs=1e-6)
        assert steps.states[:, [AX, AY]] == pytest.approx(np.tile(ACCELERATION, (11, 1)), abs=1e-4)
        assert steps.velocity == pytest.approx(velocity[1:], abs=1e-6)
        assert np.array_equal(steps.states[:, [W, H]], boxes[:-1, 2:])
        assert steps.interval_s == DT


def test_parabola_with_the_smallest_window() -> None:
    boxes, velocity = parabola(12)
    steps = samples([track(boxes)], DT, 1)
    assert steps.states[:, [VX, VY]] == pytest.approx(velocity[:-1], abs=1e-6)
    assert steps.velocity == pytest.approx(velocity[1:], abs=1e-6)


def test_smoothing_lowers_the_noise() -> None:
    """A straight line with pixel noise of 0.5: the plain difference has 0.5 sqrt(2) / dt = 17.7 px/s, the
    slope of nine frames 0.5 / (dt sqrt(60)) = 1.6 px/s, all but the ends."""
    rng = np.random.default_rng(0)
    boxes = np.column_stack([50 + 2.0 * np.arange(400), np.full(400, 40.0), np.full((400, 2), 10.0)])
    boxes[:, :2] += 0.5 * rng.standard_normal((400, 2))
    plain = samples([track(boxes)], DT, 0).states[:, VX]
    smooth = samples([track(boxes)], DT, 4).states[4:-4, VX]
    assert plain.std() == pytest.approx(17.7, rel=0.15)
    assert smooth.std() == pytest.approx(1.6, rel=0.25)
    assert smooth.mean() == pytest.approx(50.0, abs=0.5)


def test_plain_differences_by_hand() -> None:
    """x = 0, 4, 8, 4 at 10 frames/s: at the second frame 40 px/s before and after, at the third 40 before
    and -40 after."""
    boxes = np.array([[0, 7, 5, 6], [4, 7, 5, 6], [8, 7, 5, 6], [4, 7, 5, 6]], dtype=float)
    steps = samples([track(boxes)], 0.1, 0)
    assert steps.states[:, X] == pytest.approx([4.0, 8.0])
    assert steps.states[:, VX] == pytest.approx([40.0, 40.0])
    assert steps.velocity[:, 0] == pytest.approx([40.0, -40.0])
    assert steps.states[:, VY] == pytest.approx([0.0, 0.0])
    assert np.array_equal(steps.states[:, [AX, AY]], np.zeros((2, 2)))


def test_labels_belong_to_the_step_that_led_to_the_frame() -> None:
    boxes, _ = parabola(5)
    labelled = track(boxes, labels=[-1, 0, 0, 1, -1])
    assert np.array_equal(samples([labelled], DT, 2).given, [0, 0, 1, -1])
    # With plain differences the step to the second frame is left out.
    assert np.array_equal(samples([labelled], DT, 0).given, [0, 1, -1])
    assert np.array_equal(samples([track(boxes)], DT, 2).given, [-1] * 4)


def test_gaps_split_a_track() -> None:
    boxes, _ = parabola(9)
    frames = np.array([3, 4, 5, 9, 10, 11, 12, 20, 21])
    gapped = Track(frames, boxes, np.arange(9))
    parts = split_at_gaps(gapped)
    assert [part.frames.tolist() for part in parts] == [[3, 4, 5], [9, 10, 11, 12], [20, 21]]
    assert all(part.labels is not None for part in parts)
    assert np.array_equal(np.concatenate([part.boxes for part in parts]), boxes)
    steps = samples([gapped], DT, 2)
    # Two steps of the first part, three of the second; the third is too short.
    assert np.array_equal(steps.starts, [True, False, True, False, False])
    assert np.array_equal(steps.given, [1, 2, 4, 5, 6])
    assert np.array_equal(steps.states[:, W], boxes[[0, 1, 3, 4, 5], 2])


def test_no_step_crosses_a_gap() -> None:
    """The object jumps by 500 px while it is not seen; no step has that speed."""
    boxes = np.column_stack([np.arange(8.0), np.zeros(8), np.full((8, 2), 10.0)])
    boxes[4:, 0] += 500
    steps = samples([Track(np.array([1, 2, 3, 4, 8, 9, 10, 11]), boxes)], 1.0, 0)
    assert np.abs(steps.velocity[:, 0]) == pytest.approx(np.ones(4))
    assert steps.states[:, VX] == pytest.approx(np.ones(4))


def test_tracks_follow_one_another() -> None:
    boxes, _ = parabola(6)
    steps = samples([track(boxes[:4]), track(boxes[:2]), track(boxes)], DT, 2)
    assert np.array_equal(np.flatnonzero(steps.starts), [0, 3])
    assert len(steps.states) == len(steps.velocity) == len(steps.given) == 3 + 5


@pytest.mark.parametrize("half_window", [0, 1, 3])
def test_too_short_tracks_are_refused(half_window: int) -> None:
    boxes, _ = parabola(4)
    gapped = Track(np.array([1, 2, 7, 8]), boxes)
    for tracks in ([], [track(boxes[:2])], [gapped]):
        with pytest.raises(ValueError, match="three consecutive frames"):
            samples(tracks, DT, half_window)
    assert len(samples([track(boxes[:3])], DT, half_window).states) == (1 if half_window == 0 else 2)
