"""Learning from labelled footage: `Learned` is all that a region's filter knows.

A `Track` is one labelled object; `samples` takes its steps apart. `fit_motion` tells which motion model made
each step and how fast and noisy each model is (`MotionFit`), `fit_transitions` how often and where one follows another
(`TransitionFit`), `fit_lump` and `fit_histogram` what tells an object from the rest in `LabelledView`s. `judge` asks a
likelihood about labelled pictures, `reliability` compares its answers with the truth, and `folds` holds objects
out. Sizes by row are learned by `jdt.learn_profile`.
"""

from lumpwatch.models.learning.examples import LabelledView
from lumpwatch.models.learning.fit import fit_histogram, fit_lump
from lumpwatch.models.learning.learned import HistogramFit, Learned, LumpFit
from lumpwatch.models.learning.logistic import LogisticFit
from lumpwatch.models.learning.motion import ModelSpec, MotionFit, fit_motion
from lumpwatch.models.learning.tracker_fit import ForegroundChoice, Noise, TrackerFit, fit_noise, fit_size
from lumpwatch.models.learning.tracks import Samples, Track, samples
from lumpwatch.models.learning.transitions import TransitionFit, fit_transitions
from lumpwatch.models.learning.validation import Bin, Verdict, folds, judge, reliability

__all__ = [
    "Bin",
    "ForegroundChoice",
    "HistogramFit",
    "LabelledView",
    "Learned",
    "LogisticFit",
    "LumpFit",
    "ModelSpec",
    "MotionFit",
    "Noise",
    "Samples",
    "Track",
    "TrackerFit",
    "TransitionFit",
    "Verdict",
    "fit_histogram",
    "fit_lump",
    "fit_motion",
    "fit_noise",
    "fit_size",
    "fit_transitions",
    "folds",
    "judge",
    "reliability",
    "samples",
]
