"""What the feed of a region does, and what the plant says that it does."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class FeedState(StrEnum):
    """What the feed does."""

    RUNNING = "running"
    STOPPED = "stopped"
    """There is material, and it stands."""
    EMPTY = "empty"
    """Hardly any material lies there, whether the belt runs or stands, where material was seen to pass before."""
    UNKNOWN = "unknown"
    """It cannot be told: too little has been seen, or what is seen neither moves nor stands recognisably."""


@dataclass(frozen=True, slots=True)
class PlantFeed:
    """What the plant says of the feed."""

    signal: str
    """Name of the signal."""
    until_s: float
    """Until when it is valid, on the clock of decisions."""
    runs: bool | None = None
    """Whether the feeder runs; None: the signal does not say so."""
    speed_mm_s: float | None = None
    """Speed of the belt; None: the signal does not say so."""


@dataclass(frozen=True, slots=True)
class VisibleSizes:
    """Sizes of the stones that are seen: a trend, not a sieve."""

    p50_mm: float
    """Half of the visible stones' area belongs to stones that are smaller."""
    p80_mm: float
    """The same of four fifths of it."""
    stones: int
    """How many measurements of stones that is from."""


@dataclass(frozen=True, slots=True)
class FeedStatus:
    """What the feed of a region does."""

    state: FeedState = FeedState.UNKNOWN
    since_s: float | None = None
    """Capture time from which on it has been in that state; None: nothing has been seen yet."""
    speed_px_s: float | None = None
    """Median speed of what is seen to move, pixels of the picture; 0 while it stands; None: not known."""
    speed_mm_s: float | None = None
    """Speed of the belt towards the lip; None where it is not known, and without a calibration."""
    load: float | None = None
    """Share of the belt that is covered, 0 to 1; None: not known."""
    plant: PlantFeed | None = None
    """What the plant says, as long as that is valid."""
    agrees: bool | None = None
    """Whether that agrees with what is seen; None: the plant says nothing, or nothing is seen."""
    visible: VisibleSizes | None = None
    """On a calibrated belt with a net of lumps, once enough has been seen."""
