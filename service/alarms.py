"""The alarm of one ROI as a pure state machine, in the words of ISA-18.2.

    NORMAL --raised--> UNACKNOWLEDGED --acknowledged--> ACKNOWLEDGED --cleared--> NORMAL
                            |  ^                             ^
                         cleared raised                      |
                            v  |                             |
                         RETURNED (latched) --acknowledged--> NORMAL

It is raised when existence stays above `raise_above` for `on_delay_s`, and cleared when it stays
below `clear_below` for `off_delay_s`. Without `latch`, clearing leads to NORMAL at once. Times are
seconds on whatever clock the caller uses, and never go back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from service.config.alarm import AlarmConfig


class AlarmState(StrEnum):
    """Where the alarm stands."""

    NORMAL = "NORMAL"
    UNACKNOWLEDGED = "UNACKNOWLEDGED"
    ACKNOWLEDGED = "ACKNOWLEDGED"
    RETURNED = "RETURNED"

    @property
    def active(self) -> bool:
        """Whether the lump is there."""
        return self in (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED)


class Change(StrEnum):
    """What happened to the alarm."""

    RAISED = "raised"
    CLEARED = "cleared"
    ACKNOWLEDGED = "acknowledged"


@dataclass(frozen=True, slots=True)
class Transition:
    """One change of the alarm."""

    change: Change
    before: AlarmState
    after: AlarmState
    time_s: float
    actor: str | None = None
    """Who acknowledged."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """The alarm and the start of the delay that is running, if one is."""

    state: AlarmState = AlarmState.NORMAL
    since_s: float | None = None
    """Since when existence has been beyond the threshold that would change the condition."""
    actor: str | None = None


def step(
    alarm: Alarm, config: AlarmConfig, existence: float, time_s: float
) -> tuple[Alarm, Transition | None]:
    """The alarm after an existence was decided at `time_s`, and what changed."""
    crossed = existence < config.clear_below if alarm.state.active else existence > config.raise_above
    if not crossed:
        return (alarm if alarm.since_s is None else replace(alarm, since_s=None)), None
    since = time_s if alarm.since_s is None else alarm.since_s
    delay = config.off_delay_s if alarm.state.active else config.on_delay_s
    # Time stamps are multiples of a frame interval: without the margin, rounding would add a frame.
    if time_s - since < delay - 1e-6:
        return replace(alarm, since_s=since), None
    if not alarm.state.active:
        return _change(alarm, Change.RAISED, AlarmState.UNACKNOWLEDGED, time_s)
    latched = config.latch and alarm.state is AlarmState.UNACKNOWLEDGED
    return _change(alarm, Change.CLEARED, AlarmState.RETURNED if latched else AlarmState.NORMAL, time_s)


def acknowledge(alarm: Alarm, actor: str, time_s: float) -> tuple[Alarm, Transition | None]:
    """The alarm after `actor` has acknowledged it; no transition where there was nothing to acknowledge."""
    match alarm.state:
        case AlarmState.UNACKNOWLEDGED:
            after = AlarmState.ACKNOWLEDGED
        case AlarmState.RETURNED:
            after = AlarmState.NORMAL
        case _:
            return alarm, None
    changed = Alarm(after, alarm.since_s, actor)
    return changed, Transition(Change.ACKNOWLEDGED, alarm.state, after, time_s, actor)


def _change(
    alarm: Alarm, change: Change, after: AlarmState, time_s: float
) -> tuple[Alarm, Transition | None]:
    return Alarm(after), Transition(change, alarm.state, after, time_s)
