"""Our full step against OpenCV's MOG2 background subtraction on the same pictures, one thread each."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle

import cv2

from tests.benchmarks.scene import KINDS, make_run, pictures
from tests.benchmarks.timing import alternate

PARTICLES, MODELS = 2000, 2


def run() -> list[dict[str, object]]:
    """A row for each likelihood; times in milliseconds."""
    cv2.setNumThreads(1)
    subtractor = cv2.createBackgroundSubtractorMOG2()
    coming = cycle(pictures())
    ours: dict[str, Callable[[], object]] = {kind: make_run(kind, PARTICLES, MODELS).step for kind in KINDS}
    seen = alternate({"mog2": lambda: subtractor.apply(next(coming)), **ours}, turns=41)
    return [
        {
            "likelihood": kind,
            "particles": PARTICLES,
            "mog2_ms": seen.ms("mog2"),
            "ours_ms": seen.ms(kind),
            "share": seen.ratio(kind, "mog2"),
        }
        for kind in KINDS
    ]
