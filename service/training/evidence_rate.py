"""How much of the evidence counts, learned by what the filter would have announced.

Two numbers decide whether a filter that scores boxes well also raises the right alarms. The *margin* is how far a
box's score must lie above even odds before it speaks for a lump: evidence gathers, so a stone that looks a little
like a lump is believed in the end if its score is above zero at all. *Looks a second*: neighbouring frames show
nearly the same, so the log likelihood ratio of each counts in part only; a second of frames is worth so many
independent looks.

Both are chosen by what they exist for, on the labelled footage and with the alarm as it is configured: lumps
announced in time, less false alarms, one weighing as much as the other; among equals the largest margin. A minute with
labels is full of lumps, and false alarms hide behind them: they are counted on the same pictures once more, with
every labelled lump taken out of the net's maps. The score knows its own training pictures too well, so each quarter of
the footage is judged by what the others taught (cross-fitting).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation.pairing import overlaps
from lumpwatch.models.learning import Learned, LumpFit
from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S
from lumpwatch.models.likelihood.lump import Maps
from lumpwatch.models.likelihood.net import STRIDE, Remembered
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import H, States, W, X, Y, blank, corners
from lumpwatch.service.config import DetectorConfig, JdtConfig, LumpConfig, RoiConfig
from lumpwatch.service.detection import (
    Detector,
    JdtDetector,
    MakeDetector,
    RegionChannel,
    make_detector,
    make_net,
)
from lumpwatch.service.training.fitting import fit_likelihood
from lumpwatch.service.training.footage import Footage, TrainingError
from lumpwatch.service.training.watching import Picture, watch

MARGINS = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
"""Margins that are tried, ascending."""
MODEST = 2.0
"""A larger margin must announce more or raise less: a minute full of lumps hardly shows the ones that it costs."""
FEW_LUMPS, MOST_WITH_FEW = 8, MODEST
"""With fewer labelled lumps larger margins are not tried."""
LOOKS = (8.0, 18.0)
"""Looks a second that are tried beside the default."""
TRIALS = len(MARGINS) + len(LOOKS)
"""Candidates that are judged, at most."""
FOLDS = 4
FIT_VIEWS = 300
"""Pictures that a fold learns from, at most."""
LEAST_WARNING_S = 1.0
"""A lump that is announced later than so long before its last label is taken for missed."""
LEAST_OVERLAP = 0.3
"""Intersection over union from which a reported box lies on a labelled one."""
_NO_BODY = -8.0
"""Logit."""
_REACH = 1.2
"""How large a part of the maps belongs to a lump, in units of its box."""


def temper(roi: RoiConfig, footage: Footage, learned: Learned, advance: Callable[[int], None]) -> Learned:
    """What was learned with its margin and looks a second; as it was where the footage cannot teach them.

    That is where the likelihood is no lump's, `evidence` is configured, hardly a picture is labelled, or a part of the
    footage teaches nothing. `advance` is told how many candidates have been judged.
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
    cleared = without_objects(footage, maps)
    done = iter(range(1, TRIALS + 1))

    def worth(looks: float, margin: float) -> int:
        announced, false = Announced(), 0
        for fold, one in zip(folds, fits, strict=True):
            tried = tuned(replace(learned, likelihood=one), looks, margin)
            for picture, channel in watch(roi, fold.judged, tried, make=_with(maps)):
                announced.add(picture, channel, footage)
            false += _raised(channel for _, channel in watch(roi, fold.judged, tried, make=_with(cleared)))
        advance(next(done))
        return announced.in_time - false

    margins: tuple[float, ...] = MARGINS
    if config.likelihood.margin is not None:
        margins = (config.likelihood.margin,)
    elif learned.tracks < FEW_LUMPS:
        margins = tuple(margin for margin in MARGINS if margin <= MOST_WITH_FEW)
    reached = {margin: worth(DEFAULT_LOOKS_PER_S, margin) for margin in margins}
    margin = best(reached)
    others = {looks: worth(looks, margin) for looks in LOOKS}
    looks = max(others, key=lambda one: others[one])
    return tuned(learned, looks if others[looks] > reached[margin] else DEFAULT_LOOKS_PER_S, margin)


def best(reached: dict[float, int]) -> float:
    """The margin with the highest worth; among equals the largest that is modest, else the smallest."""
    most = max(reached.values())
    equal = [margin for margin, worth in reached.items() if worth == most]
    modest = [margin for margin in equal if margin <= MODEST]
    return max(modest) if modest else min(equal)


class Announced:
    """Which labelled lumps were announced, and when they were seen last."""

    def __init__(self) -> None:
        self._last: dict[tuple[int, int], float] = {}
        self._first: dict[tuple[int, int], float] = {}

    def add(self, picture: Picture, channel: RegionChannel, footage: Footage) -> None:
        """What stands after a picture."""
        view, moment = picture
        for track in moment.tracks:
            key = moment.clip, track
            self._last[key] = max(moment.time_s, self._last.get(key, moment.time_s))
        said = channel.detection
        if said is None or not channel.alarm.active or not said.objects or not moment.tracks:
            return
        reported = blank(len(said.objects))
        boxes = np.array([[one.x, one.y, one.w, one.h] for one in said.objects])
        reported[:, [X, Y, W, H]] = footage.roi.to_working(boxes)
        on = (overlaps(corners(view.objects), corners(reported)) > LEAST_OVERLAP).any(axis=1)
        for track, is_on in zip(moment.tracks, np.atleast_1d(on), strict=True):
            if is_on:
                self._first.setdefault((moment.clip, track), moment.time_s)

    @property
    def in_time(self) -> int:
        """Lumps announced so long before they were seen last."""
        return sum(self._last[key] - first >= LEAST_WARNING_S for key, first in self._first.items())


def without_objects(footage: Footage, maps: Maps) -> Maps:
    """The maps of the footage's pictures as if no labelled object lay in them: neither body nor outline."""
    objects = {id(item.view.gray): item.objects for item in footage.views}

    def cleared(gray: Image) -> NDArray[np.float32]:
        seen = maps(gray).copy()
        for area in _areas(objects[id(gray)]):
            seen[:2, *area] = _NO_BODY
        return seen

    return cleared


def _areas(objects: States) -> list[tuple[slice, slice]]:
    """Rows and columns of the cells that belong to each object."""
    half = 0.5 * _REACH * objects[:, [W, H]]
    low = np.maximum(np.floor((objects[:, [X, Y]] - half) / STRIDE), 0).astype(int)
    high = np.maximum(np.ceil((objects[:, [X, Y]] + half) / STRIDE), 0).astype(int)
    return [(slice(y0, y1), slice(x0, x1)) for (x0, y0), (x1, y1) in zip(low, high, strict=True)]


def _raised(channels: Iterable[RegionChannel]) -> int:
    """How often the alarm was raised."""
    count, was = 0, False
    for channel in channels:
        count += channel.alarm.active and not was
        was = channel.alarm.active
    return count


@dataclass(frozen=True, slots=True)
class Fold:
    """A stretch of the footage, and what is left to learn from: no lump is in both."""

    judged: Footage
    rest: Footage


def cut_in_folds(footage: Footage) -> list[Fold]:
    """Stretches with equally many labelled pictures each; none where hardly a picture is labelled."""
    labelled = np.flatnonzero(_labelled(footage))
    if len(labelled) < FOLDS:
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


def tuned(learned: Learned, looks_per_s: float, margin: float) -> Learned:
    """The same with other looks a second and another margin, where its likelihood is a lump's."""
    fit = learned.likelihood
    if not isinstance(fit, LumpFit):
        return learned
    return replace(learned, likelihood=replace(fit, looks_per_s=looks_per_s, margin=margin))


def tuned_like(learned: Learned, other: Learned) -> Learned:
    """The same with looks and margin of another."""
    fit = other.likelihood
    return learned if not isinstance(fit, LumpFit) else tuned(learned, fit.looks_per_s, fit.margin)


def _with(maps: Maps) -> MakeDetector:
    """Makes detectors that ask these maps."""

    def make(config: DetectorConfig, geometry: Roi, learned: Learned | None) -> Detector:
        if isinstance(config, JdtConfig):
            return JdtDetector(config, geometry, learned, maps)
        return make_detector(config, geometry, learned)

    return make
