"""What a detector finds in one frame."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from math import prod


class NotCounted(StrEnum):
    """Why an object that is followed does not count for the alarm."""

    TOO_SMALL = "too_small"
    """Smaller than what is to be found at its row: by `size_h`, the labels, or the limit."""
    TOO_LARGE = "too_large"
    """Larger than that."""
    STANDS = "stands"
    """It stays in its place while the belt around it moves: on the lens, burnt into the picture, or stuck."""


class Unlocated(StrEnum):
    """Why a region is in state LUMP though no object that counts is listed."""

    HELD = "held"
    """The lump was there a moment ago; its off-delay, or a picture that is not fit, holds the alarm."""
    SPREAD = "spread"
    """A lump is likely there, but at no single place more likely than not."""


class LipReason(StrEnum):
    """Why the seconds until the lip are not known."""

    UNCALIBRATED = "uncalibrated"
    """The ROI has no calibration."""
    NO_OBJECT = "no_object"
    """No object is located."""
    NOT_MOVING = "not_moving"
    """No object moves towards the lip, or none lies on the belt."""
    UNCERTAIN = "uncertain"
    """An object moves, but how fast is not known well enough yet; `calibration.speed_m_s` helps."""


@dataclass(frozen=True, slots=True)
class LumpSize:
    """An object on a calibrated belt."""

    speed_m_s: float
    distance_m: float
    """To the lip; negative beyond it."""
    lip_s: float | None
    """Seconds until it reaches the lip; None where it does not move towards it."""
    lip_spread_s: float | None
    """Standard deviation of that."""
    lip_reason: LipReason | None = None
    """Why `lip_s` is None."""
    longest_mm: float | None = None
    """Longest diameter; None as long as the object was not seen as a whole."""
    low_mm: float | None = None
    high_mm: float | None = None
    """The interval that holds it with 90 %."""
    equivalent_mm: float | None = None
    """Diameter of a sphere that covers as much of the picture."""
    over_limit: float = 1.0
    """Probability that the longest diameter is above the limit; 1 where that is not known, 0 where that was first
    seen at the lip."""


@dataclass(frozen=True, slots=True)
class DetectedObject:
    """The estimate of one object; lengths in full-frame pixels."""

    id: int
    x: float
    y: float
    w: float
    h: float
    """Box by its top left corner."""
    spread_x: float
    spread_y: float
    """Standard deviation of the centre."""
    existence: float
    model: str
    """The most probable motion model."""
    model_shares: tuple[tuple[str, float], ...] = ()
    """Name and probability of each motion model."""
    wrong_way: bool = False
    """Whether it moves against the configured direction."""
    vx: float = 0.0
    vy: float = 0.0
    """Velocity, px/s."""
    spread_w: float = 0.0
    spread_h: float = 0.0
    """Standard deviation of width and height."""
    spread_v: float = 0.0
    """Standard deviation of the velocity along each axis, px/s."""
    size: LumpSize | None = None
    """On a calibrated belt only."""
    not_counted: NotCounted | None = None
    """Why it does not count for the alarm; None where it does."""

    @property
    def counts(self) -> bool:
        """Whether it counts for the alarm."""
        return self.not_counted is None


@dataclass(frozen=True, slots=True)
class Detection:
    """What the filter finds in one frame."""

    existence: float
    """Probability that an object is there."""
    objects: tuple[DetectedObject, ...]
    """Those that count for the alarm, and what else a tracker follows."""
    effective_particles: float = 0.0
    """0 for a detector without particles."""
    fell_back_share: float = 0.0
    """Share of particles far from all training data (jdt only)."""
    oversize: float | None = None
    """Probability that an object is there that counts as above the limit; None without a calibration."""

    def moved(self, x: float, y: float) -> Detection:
        """The same with its objects elsewhere, full-frame pixels."""
        if not (x or y):
            return self
        objects = tuple(replace(found, x=found.x + x, y=found.y + y) for found in self.objects)
        return replace(self, objects=objects)

    def within(self, left: float, top: float, right: float, bottom: float) -> Detection:
        """The same with its boxes cut to a rectangle, full-frame pixels; each keeps a pixel at least."""

        def cut(found: DetectedObject) -> DetectedObject:
            x, y = min(max(found.x, left), right - 1.0), min(max(found.y, top), bottom - 1.0)
            w, h = min(found.x + found.w, right) - x, min(found.y + found.h, bottom) - y
            return replace(found, x=x, y=y, w=max(w, 1.0), h=max(h, 1.0))

        return replace(self, objects=tuple(map(cut, self.objects)))

    def without(self, ids: Collection[int], why: NotCounted) -> Detection:
        """The same where these objects do not count: nor do they in the existence."""
        if not ids:
            return self
        objects = tuple(
            replace(found, not_counted=why) if found.id in ids else found for found in self.objects
        )
        none_of_them = prod(
            1.0 - found.existence for found in self.objects if found.id in ids and found.counts
        )
        none = 1.0 - self.existence
        left = 1.0 - min(none / none_of_them, 1.0) if none_of_them > 0.0 else 0.0
        if none_of_them <= none:  # rounding, or objects that are sure: what else there is decides
            left = 1.0 - prod(1.0 - found.existence for found in objects if found.counts)
        return replace(self, objects=objects, existence=left)

    @property
    def counted(self) -> tuple[DetectedObject, ...]:
        """The objects that count for the alarm."""
        return tuple(found for found in self.objects if found.counts)

    @property
    def alarming(self) -> float:
        """What the alarm judges."""
        return self.existence if self.oversize is None else self.oversize
