"""What the tests of the JPDA tracker share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.jpda import ColourOptions, JpdaOptions, JpdaTracker
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]
SHAPE = (240, 360)
DT = 1 / 30
NONE = np.zeros((0, 4))
PLAIN = JpdaOptions(colour=ColourOptions(weight=0.0), space_weight=1.0)


def box(x: float, y: float, w: float = 20.0, h: float = 20.0) -> Array:
    return np.array([[x, y, w, h]])


def tracker(options: JpdaOptions = PLAIN) -> JpdaTracker:
    return JpdaTracker(options, SHAPE)


def run(
    subject: JpdaTracker, boxes: Callable[[float], Array], seconds: float, dt: float = DT
) -> list[tuple[TrackedObject, ...]]:
    return [subject.step(boxes(k * dt), dt) for k in range(round(seconds / dt))]
