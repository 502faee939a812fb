"""Cross-validation by labelled lump: each is judged by what was learned from the others.

For every fold the whole prior is learned anew without its lumps and without the pictures that show them.
Then the likelihood is asked about those pictures, and the region watches each lump come as it would live.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.jdt.births import polygon_births
from lumpwatch.models.jdt.row_profile import around_limit
from lumpwatch.models.learning import LabelledView
from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.learning.validation import BOUND, Bin, Verdict, folds, judge, reliability
from lumpwatch.models.state import H, W, X, Y
from lumpwatch.service.config import HistogramConfig, JdtConfig, LumpConfig, NetworkConfig, RoiConfig
from lumpwatch.service.detection import make_likelihood
from lumpwatch.service.training.dataset import Lump, Material
from lumpwatch.service.training.evidence_rate import tuned_like
from lumpwatch.service.training.footage import Moment, TrainingError
from lumpwatch.service.training.learner import learn
from lumpwatch.service.training.watching import watch

FOLD_VIEWS = 250
"""Pictures that a fold learns from, so that all folds together take about as long as the training."""
LEAD_S = 2.0
"""How long before its first label the region begins to watch."""
OVERLAP = 0.3
"""Intersection over union from which an estimate lies on a lump."""
TRIED = 400


@dataclass(frozen=True, slots=True)
class Judged:
    """One picture of a lump that was held out."""

    view: int
    """Index into the footage."""
    time_s: float
    ratio: float
    """Log likelihood ratio of the labelled box; NaN where it leaves the polygon."""
    background: float
    """The highest of the background; NaN where no box fits."""
    hardest: NDArray[np.float64] | None
    """State of that box (8,)."""

    @property
    def margin(self) -> float:
        """By how much the lump beats the background."""
        return self.ratio - self.background


@dataclass(frozen=True, slots=True)
class HeldOut:
    """One lump, judged by what was learned from others."""

    lump: Lump
    judged: tuple[Judged, ...]
    """The pictures that say something, in order."""
    warned_s: float | None
    """How long before its last label the alarm stood with an estimate on it; None: never."""

    @property
    def ratio(self) -> float:
        """Mean log likelihood ratio of the lump, untempered."""
        return float(np.mean([one.ratio for one in self.judged]))

    @property
    def background(self) -> float:
        """Mean of the hardest background."""
        return float(np.mean([one.background for one in self.judged]))

    @property
    def margin(self) -> float:
        """Mean of the lump's lead."""
        return self.ratio - self.background

    @property
    def won(self) -> float:
        """Share of the pictures in which no background beats the lump."""
        return float(np.mean([one.margin > 0 for one in self.judged]))

    @property
    def hardest(self) -> Judged:
        """The picture with the smallest lead."""
        return min(self.judged, key=lambda one: one.margin)


@dataclass(frozen=True, slots=True)
class Validation:
    """What held-out lumps say of the training."""

    folds: int
    lumps: tuple[HeldOut, ...]
    bins: tuple[Bin, ...]
    failures: tuple[str, ...]
    """Folds that could not be learned without their lumps, and lumps that could not be judged."""

    @property
    def whole(self) -> tuple[HeldOut, ...]:
        """The lumps that the clips show to their end."""
        return tuple(one for one in self.lumps if not one.lump.cut_off)

    @property
    def found(self) -> tuple[HeldOut, ...]:
        """Those of them that would have been found."""
        return tuple(one for one in self.whole if one.warned_s is not None)

    @property
    def missed(self) -> tuple[HeldOut, ...]:
        """Those of them that would not."""
        return tuple(one for one in self.whole if one.warned_s is None)

    @property
    def hardest(self) -> list[HeldOut]:
        """All lumps, those that would be missed first, then by how little they lead."""
        return sorted(self.lumps, key=lambda one: (one.warned_s is not None, one.margin))


def cross_validate(
    roi: RoiConfig,
    material: Material,
    wanted: int,
    advance: Callable[[int], None] = lambda _: None,
    like: Learned | None = None,
) -> Validation | None:
    """Judge every lump, in at most `wanted` folds, with the looks and the margin of what was learned `like` that.

    `advance` is told how many folds are done.

    None where there is nothing to compare: fewer than two lumps or folds, or a detector other than jdt.
    """
    config = roi.detector
    if not isinstance(config, JdtConfig) or len(material.lumps) < 2 or wanted < 2:
        return None
    rng = np.random.default_rng(config.seed)
    held: list[HeldOut] = []
    failures: list[str] = []
    ratios: list[NDArray[np.float64]] = []
    background: list[float] = []
    groups = folds(len(material.lumps), wanted)
    for number, group in enumerate(groups, start=1):
        lumps = [material.lumps[k] for k in group]
        rest = material.without(lumps, FOLD_VIEWS)
        names = ", ".join(name_of(material, lump) for lump in lumps)
        try:
            learned = learn(roi, rest.footage, rest.tracks, rest.source).learned
        except TrainingError as error:
            failures.append(f"nothing can be learned without {names} ({error})")
        else:
            learned = learned if like is None else tuned_like(learned, like)
            verdicts = _verdicts(config, material, learned, lumps, rng)
            ratios += [one.objects[np.isfinite(one.objects)] for one in verdicts.values()]
            background += [one.hardest_ratio for one in verdicts.values() if one.hardest is not None]
            for lump in lumps:
                judged = _judged(material, lump, verdicts)
                if judged:
                    held.append(HeldOut(lump, judged, _warned(roi, material, learned, lump)))
                else:
                    failures.append(f"{name_of(material, lump)} lies in no picture that could be judged")
        advance(number)
    if not held:
        return Validation(len(groups), (), (), tuple(failures))
    held.sort(key=lambda one: (one.lump.clip, one.judged[0].time_s))
    # The score is calibrated against the boxes without a lump that look most like one: so it is judged.
    bins = reliability(np.concatenate(ratios), np.array(background))
    return Validation(len(groups), tuple(held), bins, tuple(failures))


def name_of(material: Material, lump: Lump) -> str:
    """Which lump, for people."""
    return f"lump {lump.id} of {material.clips[lump.clip].name}"


def _untempered(config: JdtConfig) -> JdtConfig:
    kind: LumpConfig | HistogramConfig | NetworkConfig = config.likelihood
    untempered: dict[str, float] = {"evidence": 1.0, "bound": BOUND}
    if isinstance(kind, LumpConfig):
        untempered["margin"] = 0.0
    likelihood = kind.model_copy(update=untempered)
    return config.model_copy(update={"likelihood": likelihood})


def _verdicts(
    config: JdtConfig, material: Material, learned: Learned, lumps: Sequence[Lump], rng: np.random.Generator
) -> dict[int, Verdict]:
    """By view, for those that show one of the lumps."""
    roi = material.footage.roi
    profile = around_limit(learned.profile.scaled(float(roi.shape[0])), roi.limit_px)
    births = polygon_births(roi.mask, profile, np.ones(1))
    likelihood = make_likelihood(_untempered(config), learned, roi)
    keys = {(lump.clip, lump.id) for lump in lumps}
    return {
        k: judge(likelihood, view, births, rng, TRIED)
        for k, (view, moment) in enumerate(zip(material.footage.views, material.footage.moments, strict=True))
        if any((moment.clip, track) in keys for track in moment.tracks)
    }


def _judged(material: Material, lump: Lump, verdicts: dict[int, Verdict]) -> tuple[Judged, ...]:
    out = []
    for k, verdict in verdicts.items():
        moment = material.footage.moments[k]
        if moment.clip != lump.clip or lump.id not in moment.tracks:
            continue
        ratio = float(verdict.objects[moment.tracks.index(lump.id)])
        if np.isfinite(ratio) and np.isfinite(verdict.hardest_ratio):
            out.append(Judged(k, moment.time_s, ratio, verdict.hardest_ratio, verdict.hardest))
    return tuple(out)


def _warned(roi: RoiConfig, material: Material, learned: Learned, lump: Lump) -> float | None:
    """Let the region watch the pictures around a lump, and judge them by the rules of its alarm."""
    shown = [m.time_s for m in material.footage.moments if m.clip == lump.clip and lump.id in m.tracks]

    def around(moment: Moment) -> bool:
        return moment.clip == lump.clip and shown[0] - LEAD_S <= moment.time_s <= shown[-1]

    for (view, moment), channel in watch(roi, material.footage, learned, around):
        if not channel.alarm.active or channel.detection is None or lump.id not in moment.tracks:
            continue
        boxes = np.array([(one.x, one.y, one.w, one.h) for one in channel.detection.objects]).reshape(-1, 4)
        if len(boxes) and (overlaps(boxes, _label(material, view, moment, lump.id)) > OVERLAP).any():
            return shown[-1] - moment.time_s
    return None


def _label(material: Material, view: LabelledView, moment: Moment, track: int) -> NDArray[np.float64]:
    """The labelled box (1, 4) in pixels of the whole picture."""
    state = view.objects[moment.tracks.index(track)]
    return material.footage.roi.to_frame(state[None, [X, Y, W, H]])
