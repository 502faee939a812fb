"""Events of a shift by hand."""

from __future__ import annotations

from lumpwatch.service.core.alarm import Alarm, AlarmClass
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_log import Entry

BEGIN_S = 1_700_000_000.0
"""2023-11-14 22:13:20 UTC."""


def event(
    at_s: float,
    change: str,
    sequence: int,
    *,
    alarm_class: AlarmClass = AlarmClass.LUMP,
    alarm: Alarm = Alarm(),  # noqa: B008 - immutable
    roi: str = "apron",
    actor: str | None = None,
    clock: str = "boot",
    **details: float | str | None,
) -> Event:
    """`at_s` seconds after BEGIN_S."""
    return Event(
        time_s=BEGIN_S + at_s,
        monotonic_s=500.0 + at_s,
        clock=clock,
        camera="cam",
        roi=roi,
        alarm_class=alarm_class,
        change=change,
        before="",
        after="",
        actor=actor,
        reason=None,
        existence=0.95,
        frame=sequence,
        id=f"id-{sequence:06d}",
        sequence=sequence,
        alarm=alarm,
        details=dict(details),
    )


def entry(*arguments: object, **more: object) -> Entry:
    return Entry(event(*arguments, **more), b"{}")  # type: ignore[arg-type]
