"""The comparison on point detections: same likelihood, same distance, and the target is found."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.models.state import X, Y, blank
from tests.reproduction.points import CLUTTER, FAR, NOISE, P_D, SIDE, Scan, distance, make_scene, ours


def test_the_ratio_is_that_of_a_scan() -> None:
    states = blank(2)
    states[:, [X, Y]] = (50.0, 60.0), (150.0, 150.0)
    found = Scan(np.array([[50.0, 60.0 + NOISE]])).log_ratio(states)
    near = np.exp(-0.5) / (2.0 * np.pi * NOISE**2)
    assert found[0] == pytest.approx(np.log(1.0 - P_D + P_D * near / (CLUTTER / SIDE**2)))
    assert found[1] == pytest.approx(np.log(1.0 - P_D))
    assert Scan(np.zeros((0, 2))).log_ratio(states) == pytest.approx(np.log(1.0 - P_D))


@pytest.mark.parametrize(
    ("truth", "found", "ospa", "gospa"),
    [
        (None, None, 0.0, 0.0),
        (None, (0.0, 0.0), FAR, FAR / 2**0.5),
        ((0.0, 0.0), None, FAR, FAR / 2**0.5),
        ((0.0, 0.0), (3.0, 4.0), 5.0, 5.0),
        ((0.0, 0.0), (300.0, 400.0), FAR, FAR),
    ],
)
def test_distances_of_one_or_none(
    truth: tuple[float, float] | None, found: tuple[float, float] | None, ospa: float, gospa: float
) -> None:
    pair = (None if place is None else np.array(place) for place in (truth, found))
    assert distance(*pair) == pytest.approx((ospa, gospa))


@pytest.mark.parametrize("at_detections", [False, True])
def test_the_target_is_found_and_lost_again(at_detections: bool) -> None:
    scene = make_scene(1)
    steps = list(ours(scene, 500, 0, at_detections))
    above = np.array([existence > 0.5 for existence, _ in steps])
    there = np.array([truth is not None for truth in scene.truth])
    assert above[there][5:].mean() > 0.8
    assert above[~there].mean() < 0.2
