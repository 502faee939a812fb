"""Which time a report is about: `last`, a shift by name, or any span."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from zoneinfo import ZoneInfo

from lumpwatch.service.config import ShiftsConfig
from lumpwatch.service.core import seconds_of
from lumpwatch.service.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Window:
    """A time with a name."""

    name: str
    begin_s: float
    """Wall clock, seconds since the epoch."""
    end_s: float

    @property
    def lasts_s(self) -> float:
        """Its length."""
        return self.end_s - self.begin_s


_END_OF_TIME_S = 250e9  # the year 9892: what follows may lie beyond what a date can be
_MOST_S = 400 * 86_400.0


def report_window(text: str, shifts: ShiftsConfig, now_s: float) -> Window:
    """The time that is meant; raises ConfigError.

    `last`: the last shift that is over; `current`: the one that runs, until now; `NAME` or `NAME@DATE`: the
    last one of that name that is over, or the one that began on that day; `BEGIN/SPAN` or `BEGIN/END`: any
    time. Times without a zone are in that of the shifts.
    """
    zone = ZoneInfo(shifts.time_zone)
    if "/" in text:
        return _span(text, zone)
    name, _, day = text.partition("@")
    if day:
        try:
            found = [shift for shift in _shifts(shifts, date.fromisoformat(day)) if shift.name == name]
        except (ValueError, OverflowError):  # the day after 9999-12-31
            raise ConfigError(f"--shift '{text}': '{day}' is not a date such as 2026-11-22") from None
    else:
        today = datetime.fromtimestamp(now_s, zone).date()
        days = (today + timedelta(days=k) for k in range(-2, 1))
        begun = [shift for when in days for shift in _shifts(shifts, when) if shift.begin_s <= now_s]
        if name == "current":
            current = begun[-1]
            return Window(f"{current.name} (so far)", current.begin_s, now_s)
        over = [shift for shift in begun if shift.end_s <= now_s]
        found = [shift for shift in over if name in ("last", shift.name)][-1:]
    if not found:
        known = ", ".join(shifts.starts)
        raise ConfigError(
            f"--shift '{text}': is no shift (has {known}; or last, current, or 2026-11-22T06:00/12h)"
        )
    return found[0]


def _shifts(shifts: ShiftsConfig, day: date) -> Iterator[Window]:
    """Those that begin on a day, in order. By the wall clock: where summer time begins, one is shorter."""
    zone = ZoneInfo(shifts.time_zone)
    ordered = sorted(shifts.starts.items(), key=lambda start: start[1])
    for k, (name, begins) in enumerate(ordered):
        later = k + 1 < len(ordered)
        ends = ordered[(k + 1) % len(ordered)][1]
        yield Window(name, _at(day, begins, zone), _at(day if later else day + timedelta(days=1), ends, zone))


def _at(day: date, time: str, zone: ZoneInfo) -> float:
    return datetime.fromisoformat(f"{day.isoformat()}T{time}").replace(tzinfo=zone).timestamp()


def _span(text: str, zone: ZoneInfo) -> Window:
    begin_text, _, end_text = text.partition("/")
    begin_s = _moment(begin_text, zone)
    if begin_s is None:
        raise ConfigError(f"--shift '{text}': '{begin_text}' is not a time such as 2026-11-22T06:00")
    end_s = _moment(end_text, zone)
    if end_s is None:
        end_s = begin_s + seconds_of(end_text)
    if end_s <= begin_s:
        raise ConfigError(f"--shift '{text}': ends before it begins")
    if end_s - begin_s > _MOST_S:
        raise ConfigError(f"--shift '{text}': is longer than {_MOST_S / 86_400:g} days")
    began = datetime.fromtimestamp(begin_s, UTC).astimezone(zone)
    return Window(f"{began:%Y-%m-%d %H:%M}", begin_s, end_s)


def _moment(text: str, zone: ZoneInfo) -> float | None:
    try:
        when = datetime.fromisoformat(text)
        moment_s = (when if when.tzinfo else when.replace(tzinfo=zone)).timestamp()
    except (ValueError, OverflowError):
        return None
    return moment_s if 0 <= moment_s < _END_OF_TIME_S else None
