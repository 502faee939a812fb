"""Trackers of everything that moves before a still camera (papers 2 and 3).

Both are fed pictures and give `TrackedObject`s: `ImmPfTracker`, the IMM particle filter without transition
priors (`imm_pf`), and `JpdaTracker`, joint probabilistic data association (`jpda`). What moves is found by a
`Foreground`: `StatisticalBackground` (`background`, paper 3) or OpenCV's mixture of Gaussians
(`MixtureForeground`). `HistogramAppearance` tells objects from one another by their histograms.
"""

from lumpwatch.models.trackers.appearance import HistogramAppearance
from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground
from lumpwatch.models.trackers.foreground import Foreground, MixtureForeground, MixtureOptions
from lumpwatch.models.trackers.imm_pf import ImmPfTracker, TrackerOptions
from lumpwatch.models.trackers.jpda import JpdaOptions, JpdaTracker
from lumpwatch.models.trackers.tracked import TrackedObject

__all__ = [
    "BackgroundOptions",
    "Foreground",
    "HistogramAppearance",
    "ImmPfTracker",
    "JpdaOptions",
    "JpdaTracker",
    "MixtureForeground",
    "MixtureOptions",
    "StatisticalBackground",
    "TrackedObject",
    "TrackerOptions",
]
