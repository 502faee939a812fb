"""Spans and times as people write them."""

from __future__ import annotations

import re
from datetime import UTC, datetime

from lumpwatch.service.errors import ConfigError

_PART = re.compile(r"(\d+(?:\.\d+)?)(ms|[smhd])")
_UNITS_S = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86_400.0}


def seconds_of(text: str) -> float:
    """A span such as 90s, 30m or 1h30m; raises ConfigError, also for a number without a unit."""
    parts = _PART.findall(text)
    span_s = sum(float(number) * _UNITS_S[unit] for number, unit in parts)
    if "".join(number + unit for number, unit in parts) != text or not span_s > 0:
        unit = f"; say the unit: {text}s or {text}m" if re.fullmatch(r"\d+(\.\d+)?", text) else ""
        raise ConfigError(f"'{text}' is not a time such as 90s, 30m or 1h30m{unit}")
    return span_s


def moment_of(text: str, now_s: float) -> float | None:
    """Seconds since the epoch of an ISO 8601 time, or of a span before `now_s`; None where it is neither."""
    try:
        return datetime.fromisoformat(text).astimezone(UTC).timestamp()
    except (ValueError, OverflowError):  # the year 9999 in some zones
        pass
    try:
        return now_s - seconds_of(text)
    except ConfigError:
        return None
