"""All thresholds of one configuration, over all videos, and the one to recommend.

False alarms are counted against the hours in which no labelled lump was near: only then can one be
raised. Warning times are over all counted lumps, 0 s for one without any warning; the worst
tenth is their 10 % quantile, an observed value.

The recommended threshold is the lowest from which on, at every higher one too, the rate of false
alarms stays within the wanted one. The second half matters: far below its use an alarm never clears,
and an alarm that always stands is raised once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from lumpwatch.models.intervals import (
    RULE_OF_THREE,
    binomial_interval,
    poisson_interval,
    poisson_upper,
)
from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.detection import SHOWN_ABOVE
from lumpwatch.service.offline.backtest.episodes import Score, alarm_at, score
from lumpwatch.service.offline.backtest.record import Recording
from lumpwatch.service.offline.backtest.truth import Truth, near

# Below SHOWN_ABOVE no estimate is shown, so an alarm could not say what it is about.
THRESHOLDS = (
    SHOWN_ABOVE,
    *(0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.88, 0.9, 0.92, 0.94, 0.96, 0.97, 0.98, 0.985, 0.99),
    *(0.993, 0.995, 0.997, 0.998, 0.999, 0.9995, 0.9998, 0.9999),
)


@dataclass(frozen=True, slots=True)
class VideoRecord:
    """A video's name, recording and truth."""

    clip: str
    recording: Recording
    truth: Truth


@dataclass(frozen=True, slots=True)
class Terms:
    """What counts as announced, as false, and as few enough."""

    least_warning_s: float = 1.0
    tolerance_s: float = 0.5
    false_alarms_per_hour: float = 0.1


@dataclass(frozen=True, slots=True)
class Point:
    """One threshold."""

    raise_above: float
    clear_below: float
    lumps: int
    """Lumps that count."""
    announced: int
    """Of these, warned of in time."""
    warning_median_s: float | None
    warning_worst_tenth_s: float | None
    """None without lumps."""
    true_alarms: int
    misplaced_alarms: int
    false_alarms: int
    quiet_h: float
    """Hours without a lump near."""
    standing_share: float
    """Share of the quiet time for which the alarm stood."""

    @property
    def detection_rate(self) -> float | None:
        """Share of the lumps announced in time; None without lumps."""
        return self.announced / self.lumps if self.lumps else None

    @property
    def detection_interval(self) -> tuple[float, float]:
        """Of the detection rate."""
        return binomial_interval(self.announced, self.lumps)

    @property
    def false_per_hour(self) -> float | None:
        """False alarms an hour; None without quiet time."""
        return self.false_alarms / self.quiet_h if self.quiet_h > 0 else None

    @property
    def false_interval(self) -> tuple[float, float]:
        """Of the false alarms an hour."""
        return poisson_interval(self.false_alarms, self.quiet_h)


@dataclass(frozen=True, slots=True)
class Recommendation:
    """The threshold for a wanted rate of false alarms."""

    point: Point | None
    """None where no threshold keeps to the rate, or none of those that do announces a lump."""
    reason: str | None
    """Why there is none: `no_lumps`, `too_many_false` or `nothing_announced`."""
    below_per_hour: float
    """What the rate at the recommended (or else the highest) threshold stays below, 95 % sure."""
    needed_h: float
    """Quiet hours without any false alarm that would show the wanted rate."""
    most_announced: int
    """Lumps announced at the best threshold of the curve."""


def thresholds(config: AlarmConfig) -> tuple[float, ...]:
    """The thresholds to try, ascending: the usual ones and the configured one."""
    return tuple(sorted({*THRESHOLDS, config.raise_above}))


def point_at(judged: Sequence[VideoRecord], config: AlarmConfig, terms: Terms) -> Point:
    """What the thresholds of `config` do on all videos."""
    scores = scores_at(judged, config, terms)
    warned = [
        warned_s
        for video, result in zip(judged, scores, strict=True)
        for lump, warned_s in zip(video.truth.lumps, result.warned_s, strict=True)
        if lump.counted
    ]
    waits = np.array([warned_s or 0.0 for warned_s in warned])
    quiet_s = sum(quiet_time(video, terms) for video in judged)
    standing_s = sum(result.standing_s for result in scores)
    return Point(
        raise_above=config.raise_above,
        clear_below=config.clear_below,
        lumps=len(warned),
        announced=sum(in_time(warned_s, terms) for warned_s in warned),
        warning_median_s=float(np.median(waits)) if warned else None,
        warning_worst_tenth_s=float(np.quantile(waits, 0.1, method="lower")) if warned else None,
        true_alarms=sum(result.count("true") for result in scores),
        misplaced_alarms=sum(result.count("misplaced") for result in scores),
        false_alarms=sum(result.count("false") for result in scores),
        quiet_h=quiet_s / 3600,
        standing_share=standing_s / quiet_s if quiet_s > 0 else 0.0,
    )


def scores_at(judged: Sequence[VideoRecord], config: AlarmConfig, terms: Terms) -> list[Score]:
    """The score of each video at the thresholds of `config`."""
    return [score(video.recording, video.truth, config, terms.tolerance_s) for video in judged]


def in_time(warned_s: float | None, terms: Terms) -> bool:
    """Whether a warning before the lip came early enough to count."""
    # Times are multiples of a frame interval: the margin keeps rounding from deciding.
    return warned_s is not None and warned_s > terms.least_warning_s - 1e-6


def quiet_time(video: VideoRecord, terms: Terms) -> float:
    """Seconds of a video without a labelled lump near."""
    mask = near(video.recording.times, video.truth.lumps, terms.tolerance_s, terms.tolerance_s)
    return float(video.recording.intervals[~mask].sum())


def curve(judged: Sequence[VideoRecord], config: AlarmConfig, terms: Terms) -> tuple[Point, ...]:
    """All thresholds, ascending."""
    return tuple(point_at(judged, alarm_at(config, raise_above), terms) for raise_above in thresholds(config))


def recommend(points: Sequence[Point], terms: Terms) -> Recommendation:
    """The lowest threshold from which on the rate of false alarms keeps to the wanted one, if it announces anything."""
    good = list(takewhile(lambda point: _keeps(point, terms), reversed(points)))
    chosen = good[-1] if good else None
    point = chosen or points[-1]
    reason = None
    if not point.lumps:
        reason = "no_lumps"
    elif chosen is None:
        reason = "too_many_false"
    elif not chosen.announced:
        reason = "nothing_announced"
    return Recommendation(
        chosen if reason is None else None,
        reason,
        poisson_upper(point.false_alarms, point.quiet_h),
        RULE_OF_THREE / terms.false_alarms_per_hour,
        max(point.announced for point in points),
    )


def _keeps(point: Point, terms: Terms) -> bool:
    rate = point.false_per_hour
    return rate is not None and rate <= terms.false_alarms_per_hour
