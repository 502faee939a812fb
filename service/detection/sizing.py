"""How large the objects of a ROI are in millimetres, and when they reach the lip.

The box of one frame shows little and the next one nearly the same, so the size of an object is the
mean of the logarithm over its frames, each half second counting as one independent measurement. What no number of them
takes away is that a lump is no sphere (`SHAPE_SPREAD`), and what time does is that a new box lies badly
(`SETTLING_SPREAD`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import erf, exp, hypot, log, sqrt

import numpy as np

from lumpwatch.models.plane import Measure, OnBelt, measure
from lumpwatch.service.belt import make_plane
from lumpwatch.service.config import CalibrationConfig
from lumpwatch.service.core import DetectedObject, Detection, LipReason, LumpSize
from lumpwatch.service.errors import ConfigError

SHAPE_FACTOR = 1.23
"""A lump is longer than its silhouette shows: the longest axis seldom lies across the view."""
SHAPE_SPREAD = 0.08
"""Standard deviation of the log of a lump's longest diameter around that of its silhouette."""
SETTLING_SPREAD, SETTLING_S = 0.15, 0.5
"""What is added to it at first, and the time in which that becomes a third: a box just found does not lie well yet.
All of these come from simulated lumps, of training seeds."""
INDEPENDENT_S = 0.5
MOST_INDEPENDENT = 4
FORGET_S = 3.0
BELT_SPREAD = 0.25
"""Standard deviation of the configured speed of the belt, as a share of it: belts start, stop and slip."""
STANDS_M_S = 0.05
"""What surely moves slower than this stands."""
_INTERVAL_90 = 1.6449


@dataclass(slots=True)
class SizeTrack:
    """What is known of one object's size."""

    first_s: float
    last_s: float
    frames: int = 0
    longest: float = 0.0
    """Sum of the log of the longest diameter."""
    equivalent: float = 0.0
    variance: float = 0.0
    """Sum of the variances of the log."""
    on_the_way: bool = False
    """Whether it was seen before the lip."""


class Sizer:
    """Adds sizes to the objects of one ROI; remembers each object for as long as it is there."""

    def __init__(self, config: CalibrationConfig, width: int, height: int, certain: float = 0.5) -> None:
        """For pictures of that size; a lump counts as oversize from P(size > limit) = `certain` on.

        Raises ConfigError where the calibration makes no sense.
        """
        self._certain = certain
        self._limit = config.limit_mm
        self._belt = (
            None if config.speed_m_s is None else Measure(config.speed_m_s, BELT_SPREAD * config.speed_m_s)
        )
        self._size = (width, height)
        try:
            self._plane = make_plane(config, width, height)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        self._tracks: dict[int, SizeTrack] = {}

    def measure(self, detection: Detection, time_s: float) -> Detection:
        """The detection with a size for each object, and the probability that one is above the limit."""
        objects = tuple(self._sized(detected, time_s) for detected in detection.objects)
        self._tracks = {i: track for i, track in self._tracks.items() if time_s - track.last_s < FORGET_S}
        return replace(
            detection, objects=objects, oversize=_oversize(detection.existence, objects, self._certain)
        )

    def state(self) -> dict[int, SizeTrack]:
        """A copy of what is remembered, by object."""
        return {i: replace(track) for i, track in self._tracks.items()}

    def restore(self, tracks: dict[int, SizeTrack]) -> None:
        """Go on from there."""
        self._tracks = {i: replace(track) for i, track in tracks.items()}

    def _sized(self, detected: DetectedObject, time_s: float) -> DetectedObject:
        found = measure(
            self._plane,
            np.array([detected.x + detected.w / 2, detected.y + detected.h / 2, detected.w, detected.h]),
            np.array([detected.vx, detected.vy]),
            np.array(
                [
                    detected.spread_x,
                    detected.spread_y,
                    detected.spread_w,
                    detected.spread_h,
                    detected.spread_v,
                    detected.spread_v,
                ]
            ),
        )
        if found is None:
            return detected
        track = self._tracks.setdefault(detected.id, SizeTrack(time_s, time_s))
        track.last_s = time_s
        whole = (
            detected.x > 1
            and detected.y > 1
            and detected.x + detected.w < self._size[0] - 1
            and detected.y + detected.h < self._size[1] - 1
        )
        track.on_the_way |= found.distance_m.value > 0
        if whole and found.distance_m.value > 0:
            track.frames += 1
            track.longest += log(SHAPE_FACTOR * found.longest_mm.value)
            track.equivalent += log(found.equivalent_mm.value)
            track.variance += (found.longest_mm.spread / found.longest_mm.value) ** 2
        return replace(detected, size=self._size_of(found, track))

    def _lip(self, found: OnBelt) -> tuple[Measure | None, LipReason | None]:
        """Seconds to the lip, or why they are not known.

        The speed of a lump that was just found is hardly known yet. What it rides on moves at the belt's: where that is
        configured, both are weighed by their spreads.
        """
        if found.lip_s is not None:
            return found.lip_s, None
        seen, belt = found.towards_m_s, self._belt
        if seen.value + 2.0 * seen.spread < STANDS_M_S:
            return None, LipReason.NOT_MOVING
        if belt is None or found.distance_m.value <= 0.0:
            return None, LipReason.UNCERTAIN
        weights = belt.spread**-2, max(seen.spread, 1e-3) ** -2
        speed = (weights[0] * belt.value + weights[1] * seen.value) / sum(weights)
        spread = sum(weights) ** -0.5
        if speed <= 2.0 * spread:
            return None, LipReason.UNCERTAIN
        lip_s = found.distance_m.value / speed
        share = hypot(found.distance_m.spread / found.distance_m.value, spread / speed)
        return Measure(lip_s, lip_s * share), None

    def _size_of(self, found: OnBelt, track: SizeTrack) -> LumpSize:
        lip, reason = self._lip(found)
        size = LumpSize(
            speed_m_s=found.speed_m_s.value,
            distance_m=found.distance_m.value,
            lip_s=None if lip is None else lip.value,
            lip_spread_s=None if lip is None else lip.spread,
            lip_reason=reason,
        )
        if track.frames == 0:
            # Not yet seen whole: it counts, unless it was only seen at the lip, too late for any warning.
            return replace(size, over_limit=float(track.on_the_way))
        mean = track.longest / track.frames
        independent = min(
            1.0 + (track.last_s - track.first_s) / INDEPENDENT_S, track.frames, MOST_INDEPENDENT
        )
        settling = SETTLING_SPREAD * exp((track.first_s - track.last_s) / SETTLING_S)
        spread = sqrt(SHAPE_SPREAD**2 + settling**2 + track.variance / track.frames / independent)
        over = 1.0
        if self._limit is not None:
            over = 0.5 * (1.0 + erf((mean - log(self._limit)) / spread / sqrt(2.0)))
        return replace(
            size,
            longest_mm=exp(mean),
            low_mm=exp(mean - _INTERVAL_90 * spread),
            high_mm=exp(mean + _INTERVAL_90 * spread),
            equivalent_mm=exp(track.equivalent / track.frames),
            over_limit=over,
        )


def _oversize(existence: float, objects: tuple[DetectedObject, ...], certain: float) -> float:
    """P(an object is there that counts as too large). What has no size yet, or no place, does."""
    none_exists, none_over = 1.0, 1.0
    for detected in objects:
        if not detected.counts:
            continue
        none_exists *= 1.0 - detected.existence
        if detected.size is None or detected.size.over_limit >= certain:
            none_over *= 1.0 - detected.existence
    elsewhere = (1.0 - existence) / none_exists if none_exists > 1.0 - existence else 1.0
    return 1.0 - elsewhere * none_over
