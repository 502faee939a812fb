"""The same moment on two clocks: time-outs go by the monotonic one, wall time is for people."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime


@dataclass(frozen=True, slots=True)
class Clocks:
    """The same moment on the two clocks, to write monotonic times for people."""

    monotonic_s: float
    wall_s: float


def utc(seconds: float) -> datetime:
    """Seconds since the epoch as a UTC time stamp, to the microsecond."""
    return datetime.fromtimestamp(seconds, UTC)
