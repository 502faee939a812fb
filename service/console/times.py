"""Times as people at the site read them: in the time zone of its shifts."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import moment_of


class SiteTimes:
    """The clock of a site."""

    def __init__(self, config: SiteConfig) -> None:
        self.name = config.shifts.time_zone
        self._zone: tzinfo = ZoneInfo(self.name)

    def moment(self, time: str | float) -> str:
        """Date and time of an ISO 8601 time, or of seconds since the epoch: `2026-05-17 06:00:00`."""
        return f"{self._local(time):%Y-%m-%d %H:%M:%S}"

    def minute(self, time: str | float) -> str:
        """The same to the minute, without the year: `17. 06:00`."""
        return f"{self._local(time):%d. %H:%M}"

    def seconds_of(self, text: str, now_s: float) -> float | None:
        """Seconds since the epoch of a time that somebody typed, or of a span before now; None where it is neither."""
        try:
            typed = datetime.fromisoformat(text)
        except ValueError:
            return moment_of(text, now_s)
        return (typed if typed.tzinfo else typed.replace(tzinfo=self._zone)).timestamp()

    def _local(self, time: str | float) -> datetime:
        found = datetime.fromisoformat(time) if isinstance(time, str) else datetime.fromtimestamp(time, UTC)
        return found.astimezone(self._zone)
