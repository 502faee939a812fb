"""The experiment's truth and scores, where they can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reproduction.paper3_background.measure import score
from tests.reproduction.paper3_background.scenes import (
    ABSORBED_WITHIN,
    BACKGROUND,
    FOREGROUND,
    FPS,
    STILL_FOREGROUND,
    TRAINING,
    UNJUDGED,
    Scene,
    stopped,
)


def test_scores_by_hand() -> None:
    """Of 8 foreground pixels 6 are found, beside 2 of the background; unjudged ones and training do not count."""
    truth = np.full((TRAINING + 1, 4, 5), BACKGROUND, np.uint8)
    truth[:, :2, :4] = FOREGROUND
    truth[:, :, 4] = UNJUDGED
    masks = np.ones(truth.shape, np.bool_)
    masks[TRAINING] = False
    masks[TRAINING, :2, :3] = masks[TRAINING, 3, :2] = masks[TRAINING, :, 4] = True
    result = score(masks, Scene(np.zeros((*truth.shape, 3), np.uint8), truth))
    assert (result.precision, result.recall, result.f1) == (0.75, 0.75, 0.75)


def test_absorption_waits_for_a_whole_second() -> None:
    """Foreground for 40 frames, background for 10 and again foreground for 10; then it is absorbed."""
    masks = np.zeros((200, 4, 5), np.bool_)
    masks[20:60] = masks[70:80] = True
    pixels = np.ones((4, 5), np.bool_)
    scene = Scene(
        np.zeros((200, 4, 5, 3), np.uint8), np.zeros((200, 4, 5), np.uint8), (("stops", 20, pixels),)
    )
    # The first 30 frames of which more than half are background begin 35 frames after the change:
    # 5 of the foreground, 10 of background, 10 of foreground, 5 of background are exactly half.
    assert score(masks, scene).absorbed == {"stops": 36}
    assert score(np.ones_like(masks), scene).absorbed == {"stops": None}
    assert FPS == 30


@pytest.mark.slow
def test_truth_of_an_object_that_stops() -> None:
    scene = stopped(1)
    (_, stop, where), (_, leave, _) = scene.changes
    y, x = np.argwhere(where)[where.sum() // 2]
    assert scene.truth[stop + STILL_FOREGROUND - 1, y, x] == FOREGROUND
    unjudged = scene.truth[stop + STILL_FOREGROUND : stop + ABSORBED_WITHIN, y, x]
    assert set(unjudged.tolist()) <= {UNJUDGED, FOREGROUND}  # foreground where another passes before it
    assert (unjudged == UNJUDGED).mean() > 0.5
    settled = scene.truth[stop + ABSORBED_WITHIN : leave, y, x]
    assert (settled == BACKGROUND).mean() > 0.5
    assert set(settled.tolist()) <= {BACKGROUND, FOREGROUND}
