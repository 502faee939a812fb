"""How much a further frame says: neighbouring frames show nearly the same, so their evidence is shared out.

The log likelihood ratio of an object's frames varies around a mean that differs from object to object, and
slowly along each. Were the frames of a window independent, the mean over it would vary as much less as there
are frames; it varies less by the factor of the independent looks only (the design effect of survey
sampling; Kish 1965, section 5.4):

    looks = Var(one frame) / Var(mean over a window)

Frames that come in a second then count as so many looks, whatever the frame rate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

WINDOW_S = 1.0
LEAST, MOST = 0.5, 15.0
"""Looks a second: a handful of objects is no ground to believe anything beyond."""
DEFAULT = 1.3
"""Where nothing was learned: between what trainings on both renderings of the simulated feed find."""
_LEAST_WINDOWS = 8


def looks_per_second(tracks: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> float:
    """From the times (n,), s, and log ratios (n,) of labelled objects; DEFAULT where there is too little of it."""
    frames, means = [], []
    for times, ratios in tracks:
        window = (
            np.floor((times - times[0]) / WINDOW_S).astype(np.intp) if len(times) else np.empty(0, np.intp)
        )
        for k in np.unique(window):
            these = ratios[window == k]
            if len(these) > 1:
                frames.append(these)
                means.append(these.mean())
    if len(means) < _LEAST_WINDOWS:
        return DEFAULT
    of_frames, of_means = float(np.concatenate(frames).var()), float(np.var(means))
    return float(np.clip(of_frames / max(of_means, 1e-12) / WINDOW_S, LEAST, MOST))
