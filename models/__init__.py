"""Finding and following objects in pictures with adaptive motion models: pure numerics, arrays in and arrays out.

`jdt`         joint detection and tracking by a particle filter (paper 1), for one object and for several
`likelihood`  from a picture to the log likelihood ratio of a state
`trackers`    everything that moves before a still camera: IMM particle filter, JPDA, backgrounds (papers 2, 3)
`learning`    motion models, transitions, sizes and likelihoods from labelled footage
`picture`     whether a picture is fit to judge
`evaluation`  VACE, CLEAR MOT and identity scores
`plot`        what filters and trackers say, into matplotlib axes of the caller
`state`, `roi`, `plane`  what a particle is, from frame to working picture, from pixels to millimetres

Each package names what it offers in its own door, and `from lumpwatch.models import JdtFilter` takes any of those names
without saying where it lives; a package is imported when a name of it is first asked for. Nothing here
starts a thread, reads a clock, opens a file, keeps global state or imports `service`; random generators are arguments.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "jdt": (
        "AdaptiveSwitching", "Births", "Bounce", "ConstantAcceleration", "ConstantPosition", "ConstantVelocity",
        "ExistenceChain", "FixedSwitching", "FreeAcceleration", "JdtFilter", "KernelBirths", "MotionModel",
        "MotionPrior", "MultiJdtFilter", "PolygonBirths", "RandomWalk", "RowProfile", "Switching",
        "default_profile", "learn_profile",
        "multinomial", "polygon_births", "stratified", "systematic",
    ),
    "jdt.density": ("GridDensity", "learn_density"),
    "likelihood": ("HistogramLikelihood", "Likelihood", "LumpLikelihood", "NetworkLikelihood", "Observation"),
    "trackers": (
        "BackgroundOptions", "ImmPfTracker", "JpdaOptions", "JpdaTracker", "MixtureForeground", "StatisticalBackground",
        "TrackedObject", "TrackerOptions",
    ),
    "trackers.foreground": ("blobs",),
    "trackers.jpda": ("ColourOptions", "OneWay", "associate", "associate_star"),
    "evaluation": ("Scores", "Tracks", "evaluate", "overlaps", "tracks_of"),
    "roi": ("Roi", "View", "make_roi"),
    "state": ("Belief", "Estimate", "blank"),
}  # fmt: skip
_HOME = {name: package for package, names in _NAMES.items() for name in names}
_OTHERWISE = {"learn_density": "learn"}
"""Names that say too little without their package."""
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """A public name of a package, imported when it is asked for. Raises AttributeError for any other."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), _OTHERWISE.get(name, name))


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
