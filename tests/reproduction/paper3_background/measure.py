"""Masks against truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.background.model import without_small
from tests.reproduction.paper3_background.scenes import BACKGROUND, FOREGROUND, FPS, TRAINING, Scene

LEAST_AREA = 15
ABSORBED = 0.05
"""A change is absorbed when a smaller share of its pixels is foreground, a second long on average."""


@dataclass(frozen=True)
class Score:
    """Precision, recall and F1 over all judged pixels of a scene."""

    precision: float
    recall: float
    f1: float
    absorbed: dict[str, int | None]
    """Frames until each once-off change is absorbed; None if it never is."""


def score(masks: NDArray[np.bool_], scene: Scene) -> Score:
    """How well the masks (n, h, w) agree with the scene's truth."""
    foreground, background = scene.truth == FOREGROUND, scene.truth == BACKGROUND
    right = int((masks & foreground)[TRAINING:].sum())
    false = int((masks & background)[TRAINING:].sum())
    missed = int((~masks & foreground)[TRAINING:].sum())
    precision, recall = right / max(right + false, 1), right / max(right + missed, 1)
    f1 = 2 * right / max(2 * right + false + missed, 1)
    absorbed = {what: _absorbed(masks, frame, pixels) for what, frame, pixels in scene.changes}
    return Score(precision, recall, f1, absorbed)


def _absorbed(masks: NDArray[np.bool_], frame: int, pixels: NDArray[np.bool_]) -> int | None:
    """Frames from the change until the first second in which its pixels are background.

    Passing objects cover some of them at times, hence the median over the second.
    """
    share = masks[frame:, pixels].mean(axis=1)
    windows = np.median(np.lib.stride_tricks.sliding_window_view(share, FPS), axis=1)
    done = np.flatnonzero(windows < ABSORBED)
    return int(done[0]) if len(done) else None


def cleaned(masks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The masks without their small regions, as our model removes them."""
    return np.array([without_small(mask.astype(np.uint8) * 255, LEAST_AREA) == 255 for mask in masks])
