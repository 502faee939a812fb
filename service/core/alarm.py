"""An alarm as a pure state machine, in the words of ISA-18.2 / IEC 62682.

Two bits say where it stands: whether the condition is *active* (after its on-delay and off-delay), and
whether the alarm *waits* for an acknowledgement.

                      waits                               does not wait
    active            UNACKNOWLEDGED --acknowledged--> ACKNOWLEDGED
                        |  ^                              |
                     cleared raised                    cleared
                        v  |                              v
    not active        RETURNED ---acknowledged---> NORMAL, or LATCHED ---reset---> NORMAL

It is raised when existence stays above `raise_above` for `on_delay_s`, and cleared when it stays below
`clear_below` for `off_delay_s`. Without `latch`, clearing waits for no acknowledgement. With `needs_reset`
what was raised stays LATCHED after it is over and acknowledged, until a person resets it. From NORMAL,
RETURNED and LATCHED it is raised as UNACKNOWLEDGED. After `re_alarm_s` what still is that is announced again.

Three holds keep it from being announced: SHELVED by an operator for a limited time, SUPPRESSED by a
plant signal for as long as that is valid, OUT_OF_SERVICE until a person puts it back. The condition is
judged on meanwhile, as `active` and `inactive`. When the last hold ends and the condition is active, the
alarm is raised at once; what waited before the hold waits after it; what came and went under it does not.

Times are seconds on one clock that never goes back, and they are the present of whoever steps: a change happens
when it is decided, not when the frame that led to it was captured. Acknowledgements, holds and re-alarms can be
compared with it, so that a hold of 30 s and a re-alarm after 30 s last 30 s for the people who wait, however late
the picture is. Only the on-delay and the off-delay go by `observed_s`, the capture time: they ask how long the
belt showed something, and are compared with nothing but each other, so that jitter on the way neither shortens nor
lengthens them. In a replay both are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal, Protocol

from lumpwatch.service.errors import LumpwatchError


class AlarmClass(StrEnum):
    """What an alarm is about; each ROI has one of each.

    The rules of a class stand in the configuration under its name; everything else (event log, metrics,
    requests, states) goes by this list.
    """

    LUMP = "lump"
    BLIND = "blind"
    SYSTEM = "system"
    """The ROI judges, but not as well as it must: too late, or a proof test has failed."""
    BLOCKED = "blocked"
    """Material stands still in a crusher's mouth or a chute while the feed runs; of regions that watch one."""


class AlarmState(StrEnum):
    """Where the alarm stands."""

    NORMAL = "NORMAL"
    UNACKNOWLEDGED = "UNACKNOWLEDGED"
    ACKNOWLEDGED = "ACKNOWLEDGED"
    RETURNED = "RETURNED"
    LATCHED = "LATCHED"
    SHELVED = "SHELVED"
    SUPPRESSED = "SUPPRESSED"
    OUT_OF_SERVICE = "OUT_OF_SERVICE"

    @property
    def active(self) -> bool:
        """Whether it stands because the condition does; a held alarm does not, see `Alarm.active`."""
        return self in (AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED)


class Change(StrEnum):
    """What happened to the alarm."""

    RAISED = "raised"
    CLEARED = "cleared"
    ACKNOWLEDGED = "acknowledged"
    RESET = "reset"
    RE_ALARMED = "re_alarmed"
    ACTIVE = "active"
    """The condition came under a hold: recorded, not announced."""
    INACTIVE = "inactive"
    """The condition went under a hold."""
    SHELVED = "shelved"
    UNSHELVED = "unshelved"
    SUPPRESSED = "suppressed"
    UNSUPPRESSED = "unsuppressed"
    TAKEN_OUT = "out_of_service"
    PUT_BACK = "in_service"


Priority = Literal["critical", "high", "medium", "low"]
"""How soon an operator must respond."""


class AlarmRequestError(LumpwatchError):
    """An operator or the plant asks for what is not allowed."""


class Rules(Protocol):
    """What the machine needs of a configuration; the models in `lumpwatch.service.config.alarm` have it."""

    @property
    def raise_above(self) -> float: ...  # noqa: D102
    @property
    def clear_below(self) -> float: ...  # noqa: D102
    @property
    def on_delay_s(self) -> float: ...  # noqa: D102
    @property
    def off_delay_s(self) -> float: ...  # noqa: D102
    @property
    def latch(self) -> bool: ...  # noqa: D102
    @property
    def needs_reset(self) -> bool: ...  # noqa: D102
    @property
    def re_alarm_s(self) -> float | None: ...  # noqa: D102
    @property
    def shelve_max_s(self) -> float: ...  # noqa: D102
    @property
    def suppress_max_s(self) -> float: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Transition:
    """One change of the alarm."""

    change: Change
    before: AlarmState
    after: AlarmState
    time_s: float
    actor: str | None = None
    """Who did it; None: the machine."""
    reason: str | None = None
    """Why."""


@dataclass(frozen=True, slots=True)
class Hold:
    """What keeps an alarm from being announced."""

    actor: str
    reason: str
    until_s: float | None = None
    """When it ends by itself; None: a person ends it."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """The alarm, its holds, and the start of the delay that is running, if one is."""

    active: bool = False
    """The condition, delays applied."""
    waits: bool = False
    """For an acknowledgement."""
    latched: bool = False
    """Whether it was raised, and a person must reset it where the rules say so once it is over."""
    since_s: float | None = None
    """Since when existence has been beyond the threshold that would change the condition; of observations."""
    announced_s: float | None = None
    """When it was last raised or re-alarmed."""
    actor: str | None = None
    """Who acknowledged."""
    shelved: Hold | None = None
    suppressed: tuple[Hold, ...] = ()
    """One for each signal that is valid; its reason is the signal."""
    out_of_service: Hold | None = None

    @property
    def held(self) -> bool:
        """Whether anything keeps it from being announced."""
        return bool(self.suppressed) or not (self.shelved is self.out_of_service is None)

    @property
    def state(self) -> AlarmState:
        """In one word; of several holds the one that lasts longest by design."""
        if self.out_of_service is not None:
            return AlarmState.OUT_OF_SERVICE
        if self.suppressed:
            return AlarmState.SUPPRESSED
        if self.shelved is not None:
            return AlarmState.SHELVED
        if self.active:
            return AlarmState.UNACKNOWLEDGED if self.waits else AlarmState.ACKNOWLEDGED
        if self.waits:
            return AlarmState.RETURNED
        return AlarmState.LATCHED if self.latched else AlarmState.NORMAL


MOST_SIGNALS = 16
"""How many plant signals may suppress one alarm at a time."""

Changed = tuple[Alarm, tuple[Transition, ...]]

AlarmAction = Callable[[Alarm, Rules, float], Changed]
"""What an operator or the plant does to an alarm at a time."""


def step_alarm(
    alarm: Alarm, config: Rules, existence: float, time_s: float, *, observed_s: float | None = None
) -> tuple[Alarm, Transition | None]:
    """The alarm after an existence was decided at `time_s`, and what became of the condition.

    `observed_s` is when it was so: the capture time of the frame; None: at `time_s`.
    """
    seen_s = time_s if observed_s is None else observed_s
    crossed = existence < config.clear_below if alarm.active else existence > config.raise_above
    if not crossed:
        return (alarm if alarm.since_s is None else replace(alarm, since_s=None)), None
    since = seen_s if alarm.since_s is None else alarm.since_s
    delay = config.off_delay_s if alarm.active else config.on_delay_s
    # Time stamps are multiples of a frame interval: without the margin, rounding would add a frame.
    if seen_s - since < delay - 1e-6:
        return replace(alarm, since_s=since), None
    if alarm.active:
        waits = alarm.waits and config.latch
        latched = alarm.latched and config.needs_reset
        after = replace(
            alarm, active=False, waits=waits, latched=latched, since_s=None, announced_s=None, actor=None
        )
        return after, _transition(Change.INACTIVE if alarm.held else Change.CLEARED, alarm, after, time_s)
    if alarm.held:
        after = replace(alarm, active=True, since_s=None)
        return after, _transition(Change.ACTIVE, alarm, after, time_s)
    return _raised(alarm, time_s)


def tick_alarm(alarm: Alarm, config: Rules, time_s: float) -> Changed:
    """The alarm as time goes by: holds that are over end, what nobody acknowledged is announced again."""
    made: tuple[Transition, ...] = ()
    if _is_over(alarm.shelved, time_s):
        alarm, made = _release(alarm, replace(alarm, shelved=None), Change.UNSHELVED, time_s, None, "expired")
    for hold in alarm.suppressed:
        if _is_over(hold, time_s):
            alarm, ended = _end_signal(alarm, hold, time_s, "expired")
            made += ended
    waiting_since = alarm.announced_s
    if (
        config.re_alarm_s is not None
        and alarm.state is AlarmState.UNACKNOWLEDGED
        and waiting_since is not None
        and time_s - waiting_since >= config.re_alarm_s - 1e-6
    ):
        again = replace(alarm, announced_s=time_s)
        return again, (*made, _transition(Change.RE_ALARMED, alarm, again, time_s))
    return alarm, made


def announce_again(alarm: Alarm, time_s: float) -> tuple[Alarm, Transition | None]:
    """The alarm when the condition holds for one more reason; no transition where it is not announced."""
    if not alarm.active or alarm.held:
        return alarm, None
    after = replace(alarm, waits=True, announced_s=time_s, actor=None)
    return after, _transition(Change.RE_ALARMED, alarm, after, time_s)


def acknowledge(alarm: Alarm, actor: str, time_s: float) -> tuple[Alarm, Transition | None]:
    """The alarm after `actor` has acknowledged it; no transition where there was nothing to acknowledge."""
    if not alarm.waits:
        return alarm, None
    after = replace(alarm, waits=False, announced_s=None, actor=actor)
    return after, _transition(Change.ACKNOWLEDGED, alarm, after, time_s, actor)


def reset(alarm: Alarm, actor: str, time_s: float) -> tuple[Alarm, Transition | None]:
    """The alarm after `actor` has reset it; no transition where it is not over, not acknowledged or not latched."""
    if alarm.active or alarm.waits or not alarm.latched:
        return alarm, None
    after = replace(alarm, latched=False)
    return after, _transition(Change.RESET, alarm, after, time_s, actor)


def shelve(
    alarm: Alarm, config: Rules, time_s: float, actor: str, reason: str, for_s: float
) -> tuple[Alarm, Transition]:
    """Not announced for `for_s`; anew where it is shelved already. Raises AlarmRequestError."""
    _check_span("for_s", for_s, config.shelve_max_s)
    after = replace(alarm, shelved=Hold(actor, reason, time_s + for_s))
    return after, _transition(Change.SHELVED, alarm, after, time_s, actor, reason)


def unshelve(alarm: Alarm, time_s: float, actor: str) -> Changed:
    """Announced again; nothing where it is not shelved."""
    if alarm.shelved is None:
        return alarm, ()
    return _release(alarm, replace(alarm, shelved=None), Change.UNSHELVED, time_s, actor, None)


def suppress(
    alarm: Alarm, config: Rules, time_s: float, signal: str, valid_s: float
) -> tuple[Alarm, Transition | None]:
    """Not announced while the plant's `signal`, or another one, is valid; no transition where it is renewed.

    Raises AlarmRequestError.
    """
    _check_span("valid_s", valid_s, config.suppress_max_s)
    others = tuple(hold for hold in alarm.suppressed if hold.reason != signal)
    if len(others) >= MOST_SIGNALS:
        raise AlarmRequestError(f"signal: {MOST_SIGNALS} others suppress the alarm already")
    after = replace(alarm, suppressed=(*others, Hold(f"signal {signal}", signal, time_s + valid_s)))
    if len(others) < len(alarm.suppressed):
        return after, None
    return after, _transition(Change.SUPPRESSED, alarm, after, time_s, f"signal {signal}", signal)


def unsuppress(alarm: Alarm, time_s: float, signal: str) -> Changed:
    """The plant's signal is over; nothing where it was not valid."""
    for hold in alarm.suppressed:
        if hold.reason == signal:
            return _end_signal(alarm, hold, time_s, "ended by the plant")
    return alarm, ()


def take_out(alarm: Alarm, time_s: float, actor: str, reason: str) -> tuple[Alarm, Transition]:
    """Out of service until put back."""
    after = replace(alarm, out_of_service=Hold(actor, reason))
    return after, _transition(Change.TAKEN_OUT, alarm, after, time_s, actor, reason)


def put_back(alarm: Alarm, time_s: float, actor: str) -> Changed:
    """In service again; nothing where it is."""
    if alarm.out_of_service is None:
        return alarm, ()
    return _release(alarm, replace(alarm, out_of_service=None), Change.PUT_BACK, time_s, actor, None)


def _is_over(hold: Hold | None, time_s: float) -> bool:
    return hold is not None and hold.until_s is not None and time_s >= hold.until_s


def _end_signal(alarm: Alarm, hold: Hold, time_s: float, reason: str) -> Changed:
    freed = replace(alarm, suppressed=tuple(other for other in alarm.suppressed if other is not hold))
    return _release(alarm, freed, Change.UNSUPPRESSED, time_s, hold.actor, reason)


def _release(
    alarm: Alarm, freed: Alarm, change: Change, time_s: float, actor: str | None, reason: str | None
) -> Changed:
    """A hold has ended: `freed` is the alarm without it."""
    if freed.held or not freed.active:
        return freed, (_transition(change, alarm, freed, time_s, actor, reason),)
    # Reported as two changes, so that whoever follows the alarm sees an ordinary `raised`.
    quiet = replace(freed, active=False, latched=False)
    raised, announced = _raised(freed, time_s, quiet)
    raised = replace(raised, since_s=freed.since_s)  # an off-delay that runs goes on
    return raised, (_transition(change, alarm, quiet, time_s, actor, reason), announced)


def _raised(alarm: Alarm, time_s: float, before: Alarm | None = None) -> tuple[Alarm, Transition]:
    after = replace(
        alarm, active=True, waits=True, latched=True, since_s=None, announced_s=time_s, actor=None
    )
    return after, _transition(Change.RAISED, before or alarm, after, time_s)


def _transition(
    change: Change,
    before: Alarm,
    after: Alarm,
    time_s: float,
    actor: str | None = None,
    reason: str | None = None,
) -> Transition:
    return Transition(change, before.state, after.state, time_s, actor, reason)


def _check_span(name: str, span_s: float, longest_s: float) -> None:
    if not 0.0 < span_s <= longest_s:
        raise AlarmRequestError(f"{name}: {span_s:g} is not above 0 and at most {longest_s:g} seconds")


def all_of(changed: tuple[Alarm, Transition | None]) -> Changed:
    """One transition, or none, as a tuple of them."""
    alarm, made = changed
    return alarm, () if made is None else (made,)
