"""The comparison of filters with several motion models: the yardstick is right, and ours are near it."""

from __future__ import annotations

import numpy as np

from tests.reproduction.manoeuvres import NOISE, kalman, make_scene, measure, paper1, paper2


def test_ours_are_near_the_yardstick_that_beats_the_detections() -> None:
    best, _ = measure(kalman, 3)
    scenes = [make_scene(seed) for seed in range(3)]
    seen = [
        np.hypot(*(scan - place))
        for scene in scenes
        for scan, place in zip(scene.scans, scene.truth, strict=True)
        if scan is not None
    ]
    assert np.mean(seen) > 0.9 * NOISE * np.sqrt(np.pi / 2.0)
    assert best.mean() < 0.95 * np.mean(seen)
    for one, reach in ((paper1, 1.1), (paper2, 1.3)):
        error, _ = measure(one, 3)
        assert error.mean() < reach * best.mean()
