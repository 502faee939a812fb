"""Joint probabilistic data association: its marginals, and a tracker of boxes built on them (paper 3)."""

from lumpwatch.models.trackers.jpda.association import Association, associate, associate_star
from lumpwatch.models.trackers.jpda.options import ColourOptions, JpdaOptions
from lumpwatch.models.trackers.jpda.tracker import JpdaTracker
from lumpwatch.models.trackers.jpda.zones import OneWay

__all__ = [
    "Association",
    "ColourOptions",
    "JpdaOptions",
    "JpdaTracker",
    "OneWay",
    "associate",
    "associate_star",
]
