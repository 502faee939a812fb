"""When the next proof test is due, and when it is overdue. Pure; ages are in seconds, None: never."""

from __future__ import annotations

from datetime import datetime

from lumpwatch.service.config import ProofTestConfig

_DAY_S = 86_400.0


def is_due(config: ProofTestConfig, wall: datetime, tried_ago_s: float | None, *, conclusive: bool) -> bool:
    """Whether a test should begin; `conclusive` says whether the last try could be judged.

    Ages count on the monotonic clock, so that a step of the wall clock moves the times of day alone.
    """
    if not config.scheduled:
        return False
    if tried_ago_s is None:
        return True
    if not conclusive:
        return tried_ago_s >= config.retry_s
    if config.every_s is not None:
        return tried_ago_s >= config.every_s
    now_s = wall.hour * 3_600 + wall.minute * 60 + wall.second + wall.microsecond / 1e6
    since = min((now_s - _seconds(time_of_day)) % _DAY_S for time_of_day in config.at or ())
    return tried_ago_s > since


def is_overdue(config: ProofTestConfig, judged_ago_s: float) -> bool:
    """Whether there has been no result for too long; counted from the start where there never was one."""
    return config.scheduled and judged_ago_s > config.overdue_s


def _seconds(clock: str) -> float:
    hours, _, minutes = clock.partition(":")
    return int(hours) * 3_600.0 + int(minutes) * 60.0
