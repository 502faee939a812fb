"""What one region looks like when its picture is fit, and from where on it is not.

Thresholds come from slow estimates over reference footage: the value that a fit picture goes beyond for a
stated share of the time (`tail`), moved on by a margin for weather that the footage did not show.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lumpwatch.models.picture.measures import PictureMeasures
from lumpwatch.models.picture.medians import SlowMedian
from lumpwatch.models.picture.pattern import Pattern, learn_pattern
from lumpwatch.models.picture.tail import lower_threshold, upper_threshold


class Measure(StrEnum):
    """What is measured of a region, and judged as its median over some seconds."""

    BRIGHT = "bright"
    """95th percentile of the grey levels: too small where it is dark."""
    SATURATED = "saturated"
    """Share of saturated pixels: too large in glare."""
    SHARPNESS = "sharpness"
    """Fine over coarse structure: too small where it is blurred."""
    STRUCTURE = "structure"
    """Structure over brightness in most tiles: too small in dust and behind a cover."""
    STRANGE = "strange"
    """Share of tiles that do not look as in the reference: too large where something hides them."""
    ACTIVITY = "activity"
    """Change of all but the smallest part of the picture, against the most similar one of the last seconds: too
    small where it is frozen."""

    @property
    def too_large(self) -> bool:
        """Whether large values are bad; otherwise small ones are."""
        return self in (Measure.SATURATED, Measure.STRANGE)


DEFAULTS: Mapping[Measure, float] = {
    Measure.BRIGHT: 30.0,
    Measure.SATURATED: 0.6,
    Measure.SHARPNESS: 0.05,
    Measure.STRUCTURE: 0.008,
    Measure.ACTIVITY: 0.01,
}
"""Thresholds without a reference: black, white, without structure, the same to the bit."""

# Factors on thresholds that are too small, what is added to those that are too large.
_MARGIN = {
    Measure.BRIGHT: 0.5,
    Measure.SHARPNESS: 0.8,
    Measure.STRUCTURE: 0.7,
    Measure.ACTIVITY: 0.25,
    Measure.SATURATED: 0.15,
    Measure.STRANGE: 0.05,
}
# A belt that never stopped in the reference must not be taken for frozen when it does.
_MOST_ACTIVITY = 0.25
# A fifth of a region may look otherwise and still be ore.
_LEAST_STRANGE = 0.2
_MOST = {Measure.SATURATED: 0.9, Measure.STRANGE: 0.8}


@dataclass(frozen=True, slots=True)
class Sample:
    """One measured picture."""

    time_s: float
    measures: PictureMeasures
    activity: float | None
    """None where there was no picture before."""


@dataclass(frozen=True, slots=True)
class RegionReference:
    """One region in one light, by day or by night."""

    mean: float
    """Usual mean grey level."""
    usual: Mapping[Measure, float]
    """Median of each measure."""
    thresholds: Mapping[Measure, float]
    """From where on a picture is not fit."""
    pattern: Pattern


def values(
    measures: PictureMeasures, activity: float | None, pattern: Pattern | None
) -> dict[Measure, float]:
    """Every measure of one picture that can be had."""
    found = {
        Measure.BRIGHT: measures.bright,
        Measure.SATURATED: measures.saturated,
        Measure.SHARPNESS: measures.sharpness,
        Measure.STRUCTURE: measures.structure,
    }
    if activity is not None:
        found[Measure.ACTIVITY] = activity
    if pattern is not None:
        found[Measure.STRANGE] = pattern.strange(measures)
    return found


def learn_region(clips: Sequence[Sequence[Sample]], share: float, window_s: float) -> RegionReference:
    """What pictures that are fit look like; each clip is one recording in order of time.

    `share` is that of the time for which all measures together may go beyond their thresholds on footage
    like this. Raises ValueError where nothing was measured.
    """
    pattern = learn_pattern([sample.measures for clip in clips for sample in clip])
    slow = _slow(clips, pattern, window_s)
    if any(measure not in slow for measure in Measure):
        raise ValueError("there are no two pictures close enough in time to compare")
    limits = {**slow, Measure.STRANGE: _strange_to_the_other_half(clips) or slow[Measure.STRANGE]}
    return RegionReference(
        mean=float(np.median([sample.measures.mean for clip in clips for sample in clip])),
        usual={measure: float(np.median(series)) for measure, series in slow.items()},
        thresholds={
            measure: _threshold(measure, series, share / len(Measure)) for measure, series in limits.items()
        },
        pattern=pattern,
    )


def _strange_to_the_other_half(clips: Iterable[Sequence[Sample]]) -> list[float]:
    """What single pictures of one half of the footage have that the other half does not know.

    A belt that stands shows for long what it shows for a moment while it runs, and the pattern does not know
    the ore of tomorrow: the medians of its own footage would say too little of both.
    """
    halves: tuple[list[PictureMeasures], list[PictureMeasures]] = [], []
    for clip in clips:
        middle = len(clip) // 2
        for half, some in zip(halves, (clip[:middle], clip[middle:]), strict=True):
            half.extend(sample.measures for sample in some)
    if not all(halves):
        return []
    return [
        pattern.strange(measures)
        for pattern, other in zip(map(learn_pattern, halves), reversed(halves), strict=True)
        for measures in other
    ]


def _slow(clips: Iterable[Sequence[Sample]], pattern: Pattern, window_s: float) -> dict[Measure, list[float]]:
    """The slow estimates of all measures, as they are judged later."""
    series: dict[Measure, list[float]] = {}
    for clip in clips:
        medians = {measure: SlowMedian(window_s) for measure in Measure}
        for sample in clip:
            for measure, value in values(sample.measures, sample.activity, pattern).items():
                slow = medians[measure].add(sample.time_s, value)
                # What changed within a window is slow already.
                series.setdefault(measure, []).append(value if measure is Measure.ACTIVITY else slow)
    return series


def _threshold(measure: Measure, series: Sequence[float], share: float) -> float:
    if measure.too_large:
        threshold = min(upper_threshold(series, share) + _MARGIN[measure], _MOST[measure])
        return max(threshold, _LEAST_STRANGE) if measure is Measure.STRANGE else threshold
    # Ratios: their tails are those of the logarithm.
    least = np.maximum(series, 1e-3)
    threshold = float(np.exp(lower_threshold(np.log(least), share))) * _MARGIN[measure]
    if measure is Measure.ACTIVITY:
        return min(max(threshold, DEFAULTS[measure]), _MOST_ACTIVITY)
    return threshold
