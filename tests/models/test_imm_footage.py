"""The tracker on the first pictures of real footage."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lumpwatch.models.evaluation import evaluate, tracks_of
from lumpwatch.models.jdt.motion import ConstantVelocity, FreeAcceleration
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.models.trackers.imm_pf import ImmPfTracker, TrackerOptions, learn_linear
from tests.footage import footage_folder

FIRST, FPS = 120, 7.0


@pytest.mark.slow
@pytest.mark.footage
def test_pedestrians_are_found_and_fitted() -> None:
    """Far below what the experiment measures (SFDA 0.7), far above what a broken likelihood or birth gives."""
    place = footage_folder("pets2009-s2l1-view001", "vtest.avi", "gt.txt")
    if place is None:
        pytest.skip("the PETS 2009 footage is not here")
    labels = np.loadtxt(place / "gt.txt", delimiter=",", ndmin=2)
    labels = labels[labels[:, 0] <= FIRST]
    truth = tracks_of(labels[:, 0].astype(int), labels[:, 1].astype(int), labels[:, 2:6])
    size = learn_linear(np.hstack([truth.boxes[:, :2] + truth.boxes[:, 2:] / 2, truth.boxes[:, 2:]]))
    models = (ConstantVelocity("CV", 30.0), FreeAcceleration("CA", 50.0))
    tracker = ImmPfTracker(TrackerOptions(), models, size, MixtureForeground(), np.random.default_rng(0))
    capture = cv2.VideoCapture(str(place / "vtest.avi"))
    found = [
        (frame, one.id, *(one.box[:2] - one.box[2:] / 2), *one.box[2:])
        for frame in range(1, FIRST + 1)
        for one in tracker.step(np.asarray(capture.read()[1], np.uint8), 1.0 / FPS)
        if one.confirmed
    ]
    capture.release()
    table = np.array(found)
    scores = evaluate(tracks_of(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:]), truth)
    assert scores.sfda > 0.55
    assert scores.motp > 0.65
    assert scores.precision > 0.7
