"""The tracker on the first pictures of real footage."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from lumpwatch.models.evaluation import evaluate
from lumpwatch.models.jdt.motion import ConstantVelocity, FreeAcceleration
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.models.trackers.imm_pf import ImmPfTracker, TrackerOptions, learn_linear
from tests.reproduction.paper2.footage import FPS, folder, part_of, pictures, read_truth
from tests.reproduction.paper2.runner import result_of

FIRST = 120


@pytest.mark.slow
@pytest.mark.footage
def test_pedestrians_are_found_and_fitted() -> None:
    """Far below what the experiment measures (SFDA 0.7), far above what a broken likelihood or birth gives."""
    place = folder()
    if place is None:
        pytest.skip("the PETS 2009 footage is not here")
    truth = part_of(read_truth(place / "gt.txt"), 1, FIRST)
    size = learn_linear(np.hstack([truth.boxes[:, :2] + truth.boxes[:, 2:] / 2, truth.boxes[:, 2:]]))
    models = (ConstantVelocity("CV", 30.0), FreeAcceleration("CA", 50.0))
    tracker = ImmPfTracker(TrackerOptions(), models, size, MixtureForeground(), np.random.default_rng(0))
    objects = [tracker.step(one, 1.0 / FPS) for one in islice(pictures(place / "vtest.avi"), FIRST)]
    scores = evaluate(result_of(objects), truth)
    assert scores.sfda > 0.55
    assert scores.motp > 0.65
    assert scores.precision > 0.7
