"""Evaluation of a tracking result against labelled truth: VACE, CLEAR MOT and identity metrics.

`evaluate(tracks_of(frames, ids, boxes), truth)` gives all scores; the functions of the single metrics
take what `pair` makes of result and truth.
"""

from lumpwatch.models.evaluation.clear import ClearMot, clear_mot
from lumpwatch.models.evaluation.identity import idf1
from lumpwatch.models.evaluation.ignoring import without_ignored
from lumpwatch.models.evaluation.pairing import FramePair, Pairing, overlaps, pair
from lumpwatch.models.evaluation.scores import METRICS, Metric, Scores, evaluate
from lumpwatch.models.evaluation.tracks import Tracks, tracks_of
from lumpwatch.models.evaluation.vace import ata, n_moda, n_modp, sfda

__all__ = [
    "METRICS",
    "ClearMot",
    "FramePair",
    "Metric",
    "Pairing",
    "Scores",
    "Tracks",
    "ata",
    "clear_mot",
    "evaluate",
    "idf1",
    "n_moda",
    "n_modp",
    "overlaps",
    "pair",
    "sfda",
    "tracks_of",
    "without_ignored",
]
