"""A track seen by a slower camera."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.models.learning import Track
from lumpwatch.models.learning.clips import at_interval


def track(frames: list[int], labels: list[int] | None = None) -> Track:
    """An object that moves by 10 px and grows by 1 px in a frame."""
    at = np.array(frames, dtype=float)
    boxes = np.column_stack([10 * at, 5 * at, 20 + at, 30 + at])
    return Track(np.array(frames), boxes, None if labels is None else np.array(labels))


def test_the_same_interval_changes_nothing() -> None:
    one = track([3, 4, 5])
    assert at_interval(one, 0.1, 0.1005) == [one]


def test_half_the_frames() -> None:
    (slow,) = at_interval(track([3, 4, 5, 6, 7, 8], [0, 0, 0, 1, 1, 1]), 0.05, 0.1)
    assert list(slow.frames) == [2, 3, 4]
    assert slow.boxes[:, 0] == pytest.approx([40, 60, 80])
    assert slow.boxes[:, 2] == pytest.approx([24, 26, 28])
    assert slow.labels is not None
    assert list(slow.labels) == [0, 1, 1]


def test_boxes_between_two_frames_are_interpolated() -> None:
    (slow,) = at_interval(track([10, 11, 12, 13, 14, 15]), 1 / 25, 1 / 10)
    assert list(slow.frames) == [4, 5, 6]
    assert slow.boxes[:, 1] == pytest.approx([50.0, 62.5, 75.0])  # frames 10, 12.5 and 15
    assert slow.labels is None


def test_a_gap_is_not_bridged_and_short_runs_are_left_out() -> None:
    parts = at_interval(track([2, 3, 4, 5, 6, 20, 40, 41, 42]), 0.05, 0.1)
    assert [list(part.frames) for part in parts] == [[1, 2, 3], [20, 21]]
