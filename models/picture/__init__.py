"""Measures of whether a picture is fit to judge: sharp, lit, alive, unobstructed, and where it was.

`PictureMeter` measures a region's working picture (`PictureMeasures`), `Activity` how much is new in it, and
`Registration` how far the camera has moved. `learn_region` makes a `RegionReference` from pictures that are fit:
thresholds of each `Measure`, and the usual range of each tile. `DEFAULTS` are the thresholds without one. Single
pictures decide nothing: `SlowMedian` is the median over seconds.
"""

from lumpwatch.models.picture.activity import Activity
from lumpwatch.models.picture.measures import PictureMeasures, PictureMeter
from lumpwatch.models.picture.medians import JumpDetector, SlowMedian
from lumpwatch.models.picture.pattern import Pattern
from lumpwatch.models.picture.reference import Light, moving_mask, thumbnail
from lumpwatch.models.picture.region import DEFAULTS, Measure, RegionReference, Sample, learn_region, values
from lumpwatch.models.picture.registration import Registration, Shift

__all__ = [
    "DEFAULTS",
    "Activity",
    "JumpDetector",
    "Light",
    "Measure",
    "Pattern",
    "PictureMeasures",
    "PictureMeter",
    "RegionReference",
    "Registration",
    "Sample",
    "Shift",
    "SlowMedian",
    "learn_region",
    "moving_mask",
    "thumbnail",
    "values",
]
