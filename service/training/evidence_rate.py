"""How much of a frame's evidence counts, learned by whether the filter's existence can be believed.

Neighbouring frames show nearly the same, so the log likelihood ratio of each counts in part only: a second of
frames is worth so many independent looks. Too many, and a rock that looks a little like a lump is soon taken
for one; too few, and a lump is past before it is believed. The number is chosen by the logarithmic score of
P(E = 1) over the labelled footage (a strictly proper scoring rule: it is best where the probability is
right), frames with and without a lump weighing the same. The likelihood knows its own training pictures too
well, so each quarter of the footage is judged by what the others taught (cross-fitting).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning import Learned, LumpFit
from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN
from lumpwatch.models.likelihood.lump import Maps
from lumpwatch.models.likelihood.net import Remembered
from lumpwatch.models.roi import Roi
from lumpwatch.service.config import DetectorConfig, JdtConfig, LumpConfig, RoiConfig
from lumpwatch.service.detection import Detector, JdtDetector, make_detector, make_net
from lumpwatch.service.training.fitting import fit_likelihood
from lumpwatch.service.training.footage import Footage, TrainingError
from lumpwatch.service.training.watching import watch

GRID = (8.0, DEFAULT_LOOKS_PER_S, 18.0, 25.0)
"""Looks a second that are tried, ascending; the search begins with the most."""
MOST_WITH_LIMIT = 18.0
"""Most that a region with a size limit may have: what is taken for a lump by its looks is still judged by its size.
Without a limit it is the default."""
QUIET_S = 300.0
"""With so much footage without lumps all are tried: a minute full of lumps shows what too little evidence costs, and
hardly what too much does."""
MARGINS = (1.0, 1.5, DEFAULT_MARGIN)
"""Margins that are tried, ascending; the search begins with the largest."""
TRIALS = len(MARGINS) + len(GRID)
"""Candidates that are judged, at most."""
FOLDS = 4
FIT_VIEWS = 450
"""Pictures that a fold learns from, at most."""
_SURE = 0.001
"""Existence is taken as no nearer to 0 and 1 than this, or one frame could decide the score."""


def temper(roi: RoiConfig, footage: Footage, learned: Learned, advance: Callable[[int], None]) -> Learned:
    """What was learned with its looks a second; as it was where the footage cannot teach them.

    That is where the likelihood is no lump's, `evidence` is configured, all frames or none show a lump, or a
    part of the footage teaches nothing. `advance` is told how many candidates have been judged.
    """
    config, fit = roi.detector, learned.likelihood
    if not isinstance(config, JdtConfig) or not isinstance(config.likelihood, LumpConfig):
        return learned
    if config.likelihood.evidence is not None or not isinstance(fit, LumpFit):
        return learned
    folds = cut_in_folds(footage)
    profile = learned.profile.scaled(float(footage.roi.shape[0]))
    maps = Remembered(make_net())
    try:
        fits = [fit_likelihood(config, fold.rest, profile, "a part of the footage", maps) for fold in folds]
    except TrainingError:
        return learned
    if not fits:
        return learned

    def score(looks: float, margin: float) -> float:
        existence = [
            _existence(roi, fold.judged, tuned(replace(learned, likelihood=one), looks, margin), maps)
            for fold, one in zip(folds, fits, strict=True)
        ]
        present = [_labelled(fold.judged) for fold in folds]
        return log_score(np.concatenate(existence), np.concatenate(present))

    done = iter(range(1, TRIALS + 1))
    margins = MARGINS if config.likelihood.margin is None else (config.likelihood.margin,)
    margin = _best(reversed(margins), lambda one: score(fit.looks_per_s, one), lambda: advance(next(done)))
    quiet_s = footage.interval_s * footage.count * float(1.0 - _labelled(footage).mean())
    most = DEFAULT_LOOKS_PER_S if footage.roi.limit_px is None else MOST_WITH_LIMIT
    tried = [looks for looks in GRID if looks <= most or quiet_s >= QUIET_S]
    looks = _best(reversed(tried), lambda one: score(one, margin), lambda: advance(next(done)))
    return tuned(learned, looks, margin)


def _best(tried: Iterable[float], score: Callable[[float], float], told: Callable[[], None]) -> float:
    """The one with the best score, which has one peak: it is past where a score is no better than the last."""
    best, best_score = np.nan, -np.inf
    for one in tried:
        reached = score(one)
        told()
        if reached <= best_score:
            break
        best, best_score = one, reached
    return best


def log_score(existence: NDArray[np.float64], present: NDArray[np.bool_]) -> float:
    """Mean log probability given to what was so, over frames with and without an object weighing the same.

    Raises ValueError where one of them is missing.
    """
    if present.all() or not present.any():
        raise ValueError("frames with and frames without an object are needed")
    p = np.clip(existence, _SURE, 1.0 - _SURE)
    return float(np.log(p[present]).mean() + np.log(1.0 - p[~present]).mean())


@dataclass(frozen=True, slots=True)
class Fold:
    """A stretch of the footage, and what is left to learn from: no lump is in both."""

    judged: Footage
    rest: Footage


def cut_in_folds(footage: Footage) -> list[Fold]:
    """Stretches with equally many labelled pictures each; none where there are not both kinds of pictures."""
    labelled = np.flatnonzero(_labelled(footage))
    if len(labelled) < FOLDS or len(labelled) == len(footage.views):
        return []
    cuts = [0, *(int(labelled[k * len(labelled) // FOLDS]) for k in range(1, FOLDS)), len(footage.views)]
    found = []
    for first, last in pairwise(cuts):
        seen = {(m.clip, track) for m in footage.moments[first:last] for track in m.tracks}
        others = [
            k
            for k, moment in enumerate(footage.moments)
            if not first <= k < last and seen.isdisjoint((moment.clip, track) for track in moment.tracks)
        ]
        found.append(Fold(footage.only(range(first, last)), footage.only(others, FIT_VIEWS)))
    return found


def _labelled(footage: Footage) -> NDArray[np.bool_]:
    return np.array([len(item.objects) > 0 for item in footage.views], dtype=np.bool_)


def with_looks(learned: Learned, looks_per_s: float) -> Learned:
    """The same with other looks a second, where its likelihood is a lump's."""
    fit = learned.likelihood
    return learned if not isinstance(fit, LumpFit) else tuned(learned, looks_per_s, fit.margin)


def tuned(learned: Learned, looks_per_s: float, margin: float) -> Learned:
    """The same with other looks a second and another margin, where its likelihood is a lump's."""
    fit = learned.likelihood
    if not isinstance(fit, LumpFit):
        return learned
    return replace(learned, likelihood=replace(fit, looks_per_s=looks_per_s, margin=margin))


def _existence(roi: RoiConfig, footage: Footage, learned: Learned, maps: Maps) -> NDArray[np.float64]:
    """Existence after each picture, every clip from its beginning."""

    def make(config: DetectorConfig, geometry: Roi, learned: Learned | None) -> Detector:
        if isinstance(config, JdtConfig):
            return JdtDetector(config, geometry, learned, maps)
        return make_detector(config, geometry, learned)

    said = [channel.detection for _, channel in watch(roi, footage, learned, make=make)]
    return np.array([detection.existence for detection in said if detection is not None])
