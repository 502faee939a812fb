"""The experiment of where several motion models pay."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reproduction import imm


def test_paths_are_as_told() -> None:
    truth, measured, seen = imm.draw_path(imm.KINDS[0], 7.0, 3)
    steps = np.hypot(*np.diff(truth, axis=0).T)
    assert steps == pytest.approx(np.full(len(steps), imm.SPEED / 7.0))
    assert seen.all()
    assert np.std(measured - truth) == pytest.approx(imm.NOISE, rel=0.2)
    truth, _, seen = imm.draw_path(imm.KINDS[3], 7.0, 3)
    assert seen.mean() == pytest.approx(2 / 3, abs=0.05)
    steps = np.hypot(*np.diff(truth, axis=0).T)
    assert (steps < 1e-9).any()  # it stops
    assert steps.max() <= imm.SPEED / 7.0 + 1e-9


def test_gap_by_hand() -> None:
    """Errors 1, 2, 3 against 2, 2, 5: -1, 0, -2, mean -1, deviation 1."""
    results = {
        "one": imm.Result(np.array([2.0, 2.0, 5.0]), np.zeros(3)),
        "other": imm.Result(np.array([1.0, 2.0, 3.0]), np.zeros(3)),
    }
    assert imm.gap(results, "other", "after") == pytest.approx((-1.0, 1.96 / np.sqrt(3)))
    assert "better" not in imm.page({("straight", 7.0): results})


def test_a_straight_path_is_followed_and_explained() -> None:
    path = imm.draw_path("straight", 7.0, 5)
    good = imm.follow(imm.constant_velocity(15.0), path, 7.0, 0)
    loose = imm.follow(imm.constant_velocity(240.0), path, 7.0, 0)
    assert good[0] > loose[0]
    assert good[1] < 1.2 * imm.NOISE
    assert good[2] < loose[2]
