"""One row of an event log."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from lumpwatch.service.core import Alarm, AlarmClass, Hold

Details = dict[str, float | str | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One row."""

    time_s: float
    """Wall clock, seconds since the epoch."""
    monotonic_s: float
    """The same moment on the monotonic clock."""
    clock: str
    """Which monotonic clock: it lasts until the host is booted again."""
    camera: str
    roi: str
    alarm_class: AlarmClass
    change: str
    before: str
    after: str
    actor: str | None
    reason: str | None
    existence: float
    frame: int
    id: str
    """Id of the alarm record on the bus."""
    sequence: int
    """Rises by one from record to record of a ROI."""
    alarm: Alarm
    """The alarm after the event, its times on the monotonic clock."""
    details: Details = field(default_factory=dict)
    """More of what was known: `lip_s`, `longest_mm`, `low_mm`, `high_mm`, `evidence`."""

    @property
    def time(self) -> datetime:
        """Wall clock (UTC)."""
        return datetime.fromtimestamp(self.time_s, UTC)

    def public(self) -> dict[str, object]:
        """What is exported, by column."""
        return {
            "time": self.time.isoformat(),
            "monotonic_s": self.monotonic_s,
            "camera": self.camera,
            "roi": self.roi,
            "class": self.alarm_class.value,
            "change": self.change,
            "before": self.before,
            "after": self.after,
            "actor": self.actor,
            "reason": self.reason,
            "existence": self.existence,
            "frame": self.frame,
            "id": self.id,
            "sequence": self.sequence,
            "evidence": self.details.get("evidence"),
            "lip_s": self.details.get("lip_s"),
            "longest_mm": self.details.get("longest_mm"),
        }

    def alarm_now(self, monotonic_s: float, wall_s: float, clock: str) -> Alarm:
        """The alarm with its times on the monotonic clock of now.

        After a reboot the wall clock says how long ago the event was; a hold never gets longer than
        what was left of it then.
        """
        if clock == self.clock:
            return self.alarm
        ago = max(0.0, wall_s - self.time_s)

        def carried(hold: Hold) -> Hold:
            if hold.until_s is None:
                return hold
            left = hold.until_s - self.monotonic_s - ago
            return replace(hold, until_s=monotonic_s + max(0.0, left))

        alarm = self.alarm
        return replace(
            alarm,
            announced_s=None if alarm.announced_s is None else monotonic_s,
            shelved=None if alarm.shelved is None else carried(alarm.shelved),
            suppressed=tuple(carried(hold) for hold in alarm.suppressed),
        )
