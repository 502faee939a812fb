"""Learning from labelled footage: motion models and their switching, row profile, likelihood."""

from models.learning.examples import LabelledView
from models.learning.fit import fit_histogram, fit_lump
from models.learning.learned import HistogramFit, Learned, LumpFit
from models.learning.logistic import LogisticFit
from models.learning.motion import MotionFit, fit_motion
from models.learning.tracks import Samples, Track, samples

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
