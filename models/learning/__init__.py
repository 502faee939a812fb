"""Learning from labelled footage: motion models and their switching, row profile, likelihood."""

from lumpwatch.models.learning.examples import LabelledView
from lumpwatch.models.learning.fit import fit_histogram, fit_lump
from lumpwatch.models.learning.learned import HistogramFit, Learned, LumpFit
from lumpwatch.models.learning.logistic import LogisticFit
from lumpwatch.models.learning.motion import MotionFit, fit_motion
from lumpwatch.models.learning.tracks import Samples, Track, samples

__all__ = [
    "HistogramFit",
    "LabelledView",
    "Learned",
    "LogisticFit",
    "LumpFit",
    "MotionFit",
    "Samples",
    "Track",
    "fit_histogram",
    "fit_lump",
    "fit_motion",
    "samples",
]
