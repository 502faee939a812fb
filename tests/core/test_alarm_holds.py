"""Shelving, suppression, out of service, re-alarm: by hand, and against an oracle over any history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.config.alarm import BlindAlarmConfig
from lumpwatch.service.core.alarm import (
    MOST_SIGNALS,
    Alarm,
    AlarmRequestError,
    AlarmState,
    Change,
    Changed,
    Hold,
    Transition,
    acknowledge,
    all_of,
    put_back,
    reset,
    shelve,
    step_alarm,
    suppress,
    take_out,
    tick_alarm,
    unshelve,
    unsuppress,
)
from lumpwatch.service.storage.event_log import alarm_of, alarm_text

NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED, LATCHED, SHELVED, SUPPRESSED, OUT = AlarmState
AT_ONCE = AlarmConfig(on_delay_s=0.0, off_delay_s=0.0, shelve_max_s=100.0, suppress_max_s=50.0)
QUIET = Alarm()
WAITING = Alarm(active=True, waits=True, announced_s=0.0)
SEEN = Alarm(active=True, actor="Ada")
PAST = Alarm(waits=True)
ALL = (QUIET, WAITING, SEEN, PAST)

HOLDS = {
    "shelved": lambda alarm, t: all_of(shelve(alarm, AT_ONCE, t, "Ada", "dust", 10.0)),
    "suppressed": lambda alarm, t: all_of(suppress(alarm, AT_ONCE, t, "feeder", 10.0)),
    "out_of_service": lambda alarm, t: all_of(take_out(alarm, t, "Ada", "repair")),
}
ENDS = {
    "shelved": lambda alarm, t: unshelve(alarm, t, "Bob"),
    "suppressed": lambda alarm, t: unsuppress(alarm, t, "feeder"),
    "out_of_service": lambda alarm, t: put_back(alarm, t, "Bob"),
}
SHOWN = {"shelved": SHELVED, "suppressed": SUPPRESSED, "out_of_service": OUT}


def short(made: Sequence[Transition]) -> list[tuple[str, AlarmState, AlarmState]]:
    return [(one.change.value, one.before, one.after) for one in made]


# By hand


@pytest.mark.parametrize("kind", HOLDS)
@pytest.mark.parametrize("before", ALL)
def test_a_hold_covers_any_state_and_is_recorded(kind: str, before: Alarm) -> None:
    held, made = HOLDS[kind](before, 5.0)
    assert held.state is SHOWN[kind]
    assert short(made) == [(kind, before.state, SHOWN[kind])]
    assert made[0].actor == ("signal feeder" if kind == "suppressed" else "Ada")
    assert made[0].reason == {"shelved": "dust", "suppressed": "feeder", "out_of_service": "repair"}[kind]
    assert (held.active, held.waits) == (before.active, before.waits)


@pytest.mark.parametrize("kind", HOLDS)
@pytest.mark.parametrize(
    ("before", "expected"),
    [
        (QUIET, [(NORMAL,)]),
        (PAST, [(RETURNED,)]),
        (SEEN, [(NORMAL,), (NORMAL, UNACKNOWLEDGED)]),
        (WAITING, [(RETURNED,), (RETURNED, UNACKNOWLEDGED)]),
    ],
)
def test_what_is_there_when_a_hold_ends_is_announced(
    kind: str, before: Alarm, expected: list[tuple[AlarmState, ...]]
) -> None:
    held, _ = HOLDS[kind](before, 5.0)
    after, made = ENDS[kind](held, 6.0)
    assert [one.after for one in made] == [steps[-1] for steps in expected]
    assert made[0].before is SHOWN[kind]
    assert made[0].change in (Change.UNSHELVED, Change.UNSUPPRESSED, Change.PUT_BACK)
    if before.active:
        assert (made[1].change, made[1].time_s) == (Change.RAISED, 6.0)
        assert after == Alarm(active=True, waits=True, latched=True, announced_s=6.0)
    assert after.state is made[-1].after
    assert ENDS[kind](after, 7.0) == (after, ())  # ending twice is nothing


@pytest.mark.parametrize("kind", HOLDS)
def test_the_condition_is_judged_and_recorded_under_a_hold(kind: str) -> None:
    alarm, _ = HOLDS[kind](QUIET, 0.0)
    alarm, came = step_alarm(alarm, AT_ONCE, 1.0, 1.0)
    assert came == Transition(Change.ACTIVE, SHOWN[kind], SHOWN[kind], 1.0)
    assert alarm.active
    alarm, went = step_alarm(alarm, AT_ONCE, 0.0, 2.0)
    assert went == Transition(Change.INACTIVE, SHOWN[kind], SHOWN[kind], 2.0)
    _, made = ENDS[kind](alarm, 3.0)
    assert [one.after for one in made] == [NORMAL]  # came and went under the hold


@pytest.mark.parametrize("kind", HOLDS)
def test_what_waited_before_the_hold_waits_after_it_unless_acknowledged(kind: str) -> None:
    alarm, _ = HOLDS[kind](WAITING, 0.0)
    alarm, _ = step_alarm(alarm, AT_ONCE, 0.0, 1.0)
    later, _ = ENDS[kind](alarm, 2.0)
    assert later.state is RETURNED
    alarm, made = acknowledge(alarm, "Eve", 1.5)
    assert made == Transition(Change.ACKNOWLEDGED, SHOWN[kind], SHOWN[kind], 1.5, "Eve")
    later, _ = ENDS[kind](alarm, 2.0)
    assert later.state is NORMAL


@pytest.mark.parametrize("kind", ["shelved", "suppressed"])
def test_shelving_and_suppression_end_by_themselves(kind: str) -> None:
    held, _ = HOLDS[kind](SEEN, 5.0)
    assert tick_alarm(held, AT_ONCE, 14.999) == (held, ())
    after, made = tick_alarm(held, AT_ONCE, 15.0)
    assert [one.change for one in made] == [
        Change.UNSHELVED if kind == "shelved" else Change.UNSUPPRESSED,
        Change.RAISED,
    ]
    assert (made[0].actor, made[0].reason) == (None if kind == "shelved" else "signal feeder", "expired")
    assert after.state is UNACKNOWLEDGED


def test_out_of_service_does_not_end_by_itself() -> None:
    held, _ = HOLDS["out_of_service"](SEEN, 0.0)
    assert tick_alarm(held, AT_ONCE, 1e9) == (held, ())


def test_only_the_end_of_the_last_hold_announces() -> None:
    alarm, _ = HOLDS["shelved"](WAITING, 0.0)
    alarm, _ = HOLDS["suppressed"](alarm, 0.0)
    alarm, made = HOLDS["out_of_service"](alarm, 1.0)
    assert short(made) == [("out_of_service", SUPPRESSED, OUT)]
    alarm, made = tick_alarm(alarm, AT_ONCE, 10.0)  # both of the others end
    assert short(made) == [("unshelved", OUT, OUT), ("unsuppressed", OUT, OUT)]
    alarm, made = put_back(alarm, 11.0, "Bob")
    assert short(made) == [("in_service", OUT, RETURNED), ("raised", RETURNED, UNACKNOWLEDGED)]


def test_shelving_anew_takes_the_new_limit() -> None:
    alarm, _ = HOLDS["shelved"](QUIET, 0.0)
    alarm, made = shelve(alarm, AT_ONCE, 5.0, "Bob", "more dust", 20.0)
    assert (made.change, made.before, made.after) == (Change.SHELVED, SHELVED, SHELVED)
    assert alarm.shelved == Hold("Bob", "more dust", 25.0)


def test_renewing_a_signal_is_no_change_but_prolongs() -> None:
    alarm, _ = suppress(QUIET, AT_ONCE, 0.0, "feeder", 10.0)
    alarm, made = suppress(alarm, AT_ONCE, 8.0, "feeder", 10.0)
    assert made is None
    assert tick_alarm(alarm, AT_ONCE, 17.9)[1] == ()
    assert [one.change for one in tick_alarm(alarm, AT_ONCE, 18.0)[1]] == [Change.UNSUPPRESSED]
    assert unsuppress(alarm, 9.5, "maintenance") == (alarm, ())  # not the one that suppresses


def test_several_signals_suppress_until_the_last_one_ends() -> None:
    alarm, made = SEEN, []
    for second in range(10):  # two gateways that repeat their signals
        for signal in ("feeder", "maintenance"):
            alarm, change = suppress(alarm, AT_ONCE, float(second), signal, 3.0)
            made += [change.change] if change else []
    assert made == [Change.SUPPRESSED] * 2
    alarm, changes = unsuppress(alarm, 9.5, "feeder")
    assert short(changes) == [("unsuppressed", SUPPRESSED, SUPPRESSED)]
    assert tick_alarm(alarm, AT_ONCE, 11.9) == (alarm, ())
    alarm, changes = tick_alarm(alarm, AT_ONCE, 12.0)
    assert [one.change for one in changes] == [Change.UNSUPPRESSED, Change.RAISED]
    assert changes[0].actor == "signal maintenance"


def test_signals_cannot_fill_the_memory() -> None:
    alarm = QUIET
    for k in range(MOST_SIGNALS):
        alarm, _ = suppress(alarm, AT_ONCE, 0.0, f"s{k}", 9.0)
    with pytest.raises(AlarmRequestError, match="16 others"):
        suppress(alarm, AT_ONCE, 0.0, "one more", 9.0)
    assert suppress(alarm, AT_ONCE, 1.0, "s3", 9.0)[1] is None  # a renewal still is


@pytest.mark.parametrize("span_s", [0.0, -1.0, 100.1, inf, nan])
def test_a_shelving_has_a_limit(span_s: float) -> None:
    with pytest.raises(AlarmRequestError, match=r"^for_s: .*\b100 seconds$"):
        shelve(QUIET, AT_ONCE, 0.0, "Ada", "dust", span_s)


@pytest.mark.parametrize("span_s", [0.0, 50.1, inf, nan])
def test_a_suppression_has_a_limit(span_s: float) -> None:
    with pytest.raises(AlarmRequestError, match=r"^valid_s: .*\b50 seconds$"):
        suppress(QUIET, AT_ONCE, 0.0, "feeder", span_s)


def test_what_nobody_acknowledges_is_announced_again() -> None:
    config = AT_ONCE.model_copy(update={"re_alarm_s": 30.0})
    alarm, made = step_alarm(QUIET, config, 1.0, 100.0)
    assert made is not None
    again: list[Transition] = []
    for second in range(100, 200):
        alarm, changes = tick_alarm(alarm, config, float(second))
        again += changes
    assert [(one.change, one.before, one.after, one.time_s) for one in again] == [
        (Change.RE_ALARMED, UNACKNOWLEDGED, UNACKNOWLEDGED, t) for t in (130.0, 160.0, 190.0)
    ]
    assert tick_alarm(WAITING, AT_ONCE, 1e9) == (WAITING, ())  # not configured
    for other in (QUIET, SEEN, PAST, HOLDS["out_of_service"](WAITING, 0.0)[0]):
        assert tick_alarm(other, config, 1e9) == (other, ())


def test_an_alarm_goes_by_the_present_and_its_delays_by_what_was_seen() -> None:
    """Frames come 5 s late: the on-delay is that of the frames, all else that of the people who wait."""
    config = AlarmConfig(on_delay_s=2.0, re_alarm_s=30.0)
    alarm, made = step_alarm(QUIET, config, 1.0, 105.0, observed_s=100.0)
    assert made is None
    alarm, made = step_alarm(alarm, config, 1.0, 107.5, observed_s=101.5)
    assert made is None  # jitter on the way does not shorten it
    alarm, made = step_alarm(alarm, config, 1.0, 107.6, observed_s=102.0)
    assert made is not None
    assert (made.change, made.time_s, alarm.announced_s) == (Change.RAISED, 107.6, 107.6)
    assert tick_alarm(alarm, config, 137.5) == (alarm, ())  # by the capture time it would be due
    _, changes = tick_alarm(alarm, config, 137.7)
    assert [one.change for one in changes] == [Change.RE_ALARMED]


LATCHING = AlarmConfig(on_delay_s=0.0, off_delay_s=0.0, needs_reset=True)


def test_what_needs_a_reset_stands_until_someone_resets_it() -> None:
    alarm, _ = step_alarm(QUIET, LATCHING, 1.0, 0.0)
    assert reset(alarm, "Ada", 1.0) == (alarm, None)  # it is still there
    alarm, _ = step_alarm(alarm, LATCHING, 0.0, 2.0)
    assert (alarm.state, reset(alarm, "Ada", 3.0)) == (RETURNED, (alarm, None))  # nobody has seen it
    alarm, made = acknowledge(alarm, "Ada", 4.0)
    assert made == Transition(Change.ACKNOWLEDGED, RETURNED, LATCHED, 4.0, "Ada")
    assert acknowledge(alarm, "Ada", 5.0) == (alarm, None)
    again, made = step_alarm(alarm, LATCHING, 1.0, 6.0)
    assert (made and made.change, again.state) == (Change.RAISED, UNACKNOWLEDGED)
    alarm, made = reset(alarm, "Bob", 7.0)
    assert made == Transition(Change.RESET, LATCHED, NORMAL, 7.0, "Bob")
    assert alarm == replace(QUIET, actor="Ada")
    assert reset(alarm, "Bob", 8.0) == (alarm, None)


def test_what_was_acknowledged_while_it_was_there_is_latched_when_it_is_over() -> None:
    alarm, _ = acknowledge(step_alarm(QUIET, LATCHING, 1.0, 0.0)[0], "Ada", 1.0)
    alarm, made = step_alarm(alarm, LATCHING, 0.0, 2.0)
    assert made == Transition(Change.CLEARED, ACKNOWLEDGED, LATCHED, 2.0)
    assert alarm_of(alarm_text(alarm)).state is LATCHED  # a restart does not reset it


@pytest.mark.parametrize("kind", HOLDS)
def test_what_only_came_under_a_hold_is_not_latched(kind: str) -> None:
    held, _ = HOLDS[kind](QUIET, 0.0)
    for existence in (1.0, 0.0):
        held, _ = step_alarm(held, LATCHING, existence, 1.0)
    assert ENDS[kind](held, 2.0)[0].state is NORMAL
    raised, _ = acknowledge(step_alarm(QUIET, LATCHING, 1.0, 0.0)[0], "Ada", 1.0)
    held, _ = step_alarm(HOLDS[kind](raised, 2.0)[0], LATCHING, 0.0, 3.0)
    assert ENDS[kind](held, 4.0)[0].state is LATCHED  # it was announced before


def test_blindness_is_judged_by_the_same_machine() -> None:
    rules = BlindAlarmConfig(on_delay_s=1.0, off_delay_s=0.5, latch=True)
    alarm, made = QUIET, []
    for k in range(40):
        alarm, change = step_alarm(alarm, rules, 1.0 if 5 <= k < 25 else 0.0, k / 10)
        made += [change] if change else []
    assert [(one.change, one.time_s) for one in made] == [
        (Change.RAISED, 1.5),
        (Change.CLEARED, 3.0),
    ]
    assert alarm.state is RETURNED


def test_both_classes_are_configured_each_by_itself() -> None:
    config = AlarmConfig.model_validate({"priority": "critical", "blind": {"priority": "low", "latch": True}})
    assert (config.priority, config.blind.priority, config.blind.latch) == ("critical", "low", True)
    for bad in ({"priority": "urgent"}, {"re_alarm_s": 0}, {"blind": {"raise_above": 0.9}}):
        with pytest.raises(ValueError, match="validation error"):
            AlarmConfig.model_validate(bad)


# Any history, against an oracle

LEGAL = {
    Change.RAISED: {(one, UNACKNOWLEDGED) for one in (NORMAL, RETURNED, LATCHED)},
    Change.CLEARED: {
        (UNACKNOWLEDGED, RETURNED),
        *((one, over) for one in (UNACKNOWLEDGED, ACKNOWLEDGED) for over in (NORMAL, LATCHED)),
    },
    Change.ACKNOWLEDGED: {(UNACKNOWLEDGED, ACKNOWLEDGED), (RETURNED, NORMAL), (RETURNED, LATCHED)},
    Change.RESET: {(LATCHED, NORMAL)},
    Change.RE_ALARMED: {(UNACKNOWLEDGED, UNACKNOWLEDGED)},
}
HELD = (SHELVED, SUPPRESSED, OUT)
STARTS = {Change.SHELVED: SHELVED, Change.SUPPRESSED: SUPPRESSED, Change.TAKEN_OUT: OUT}
STOPS = {Change.UNSHELVED: SHELVED, Change.UNSUPPRESSED: SUPPRESSED, Change.PUT_BACK: OUT}


def legal(one: Transition) -> bool:
    if one.change in LEGAL and (one.before, one.after) in LEGAL[one.change]:
        return True
    if one.change in (Change.ACTIVE, Change.INACTIVE, Change.ACKNOWLEDGED, Change.RESET):
        return one.before is one.after and one.before in HELD
    if one.change in STARTS:  # a hold that lasts longer by design hides a shorter one
        return one.after in HELD and HELD.index(one.after) >= HELD.index(STARTS[one.change])
    if one.change in STOPS:
        hidden = one.before is one.after and HELD.index(one.before) > HELD.index(STOPS[one.change])
        shown = one.before is STOPS[one.change] and one.after in (
            NORMAL,
            RETURNED,
            LATCHED,
            SHELVED,
            SUPPRESSED,
        )
        return hidden or shown
    return False


@dataclass(frozen=True)
class Event:
    """What happens after `wait_s`: a frame with an existence, or what somebody does."""

    wait_s: float
    what: str
    value: float = 0.0


EVENTS = st.one_of(
    st.builds(Event, st.just(0.1), st.just("frame"), st.sampled_from([0.0, 0.3, 0.6, 0.95, 1.0])),
    st.builds(
        Event,
        st.sampled_from([0.0, 0.05, 3.0]),
        st.sampled_from(
            [
                "ack",
                "reset",
                "shelve",
                "unshelve",
                "suppress",
                "other_signal",
                "unsuppress",
                "take_out",
                "put_back",
                "restart",
                "look",
            ]
        ),
        st.sampled_from([0.3, 1.0, 5.0]),
    ),
)
CONFIGS = st.builds(
    AlarmConfig,
    on_delay_s=st.sampled_from([0.0, 0.25]),
    off_delay_s=st.sampled_from([0.0, 0.35]),
    latch=st.booleans(),
    needs_reset=st.booleans(),
    re_alarm_s=st.sampled_from([None, 0.7]),
)


@st.composite
def histories(draw: st.DrawFn) -> list[Event]:
    """Runs of equal frames with deeds between them: single frames would hardly ever pass a delay."""
    events: list[Event] = []
    for event, times in draw(st.lists(st.tuples(EVENTS, st.integers(1, 6)), max_size=40)):
        events += [event] * (times if event.what == "frame" else 1)
    return events


class Oracle:
    """Keeps the whole history and answers by looking back over it."""

    def __init__(self, config: AlarmConfig) -> None:
        self.config = config
        self.active = False
        self.run: list[float] = []
        """Times of the last frames in a row that speak for a change."""
        self.until: dict[str, float] = {}
        self.seen = True
        """Whether somebody has acknowledged what was last announced."""
        self.latched = False
        """Whether what was announced must be reset."""

    def frame(self, existence: float, now: float) -> None:
        beyond = existence < self.config.clear_below if self.active else existence > self.config.raise_above
        self.run = [*self.run, now] if beyond else []
        delay = self.config.off_delay_s if self.active else self.config.on_delay_s
        if self.run and now - self.run[0] >= delay - 1e-6:
            self.active, self.run = not self.active, []
            if not self.active and not self.config.latch:
                self.seen = True
            if not self.active and not self.config.needs_reset:
                self.latched = False

    def hold(self, kind: str, until: float) -> None:
        self.until[kind] = until


def deed(alarm: Alarm, config: AlarmConfig, event: Event, now: float, oracle: Oracle) -> Changed:
    match event.what:
        case "frame":
            oracle.frame(event.value, now)
            return all_of(step_alarm(alarm, config, event.value, now))
        case "ack":
            oracle.seen = True
            return all_of(acknowledge(alarm, "Ada", now))
        case "reset":
            if not oracle.active and oracle.seen:
                oracle.latched = False
            return all_of(reset(alarm, "Ada", now))
        case "shelve":
            oracle.hold("shelved", now + event.value)
            return all_of(shelve(alarm, config, now, "Ada", "dust", event.value))
        case "suppress":
            oracle.hold("suppressed", now + event.value)
            return all_of(suppress(alarm, config, now, "feeder", event.value))
        case "other_signal":
            oracle.hold("other_signal", now + event.value)
            return all_of(suppress(alarm, config, now, "maintenance", event.value))
        case "take_out":
            oracle.hold("out", inf)
            return all_of(take_out(alarm, now, "Ada", "repair"))
        case "unshelve":
            oracle.until.pop("shelved", None)
            return unshelve(alarm, now, "Ada")
        case "unsuppress":
            oracle.until.pop("suppressed", None)
            return unsuppress(alarm, now, "feeder")
        case "put_back":
            oracle.until.pop("out", None)
            return put_back(alarm, now, "Ada")
        case "restart":
            oracle.run = []
            return alarm_of(alarm_text(alarm)), ()
    return alarm, ()


@settings(max_examples=400)
@given(CONFIGS, histories())
def test_no_history_loses_an_alarm(config: AlarmConfig, history: list[Event]) -> None:
    alarm, oracle, now, shown = Alarm(), Oracle(config), 0.0, NORMAL
    for event in history:
        now = round(now + event.wait_s, 6)
        was = oracle.active and not oracle.until
        alarm, made = deed(alarm, config, event, now, oracle)
        alarm, more = tick_alarm(alarm, config, now)
        oracle.until = {kind: until for kind, until in oracle.until.items() if until > now}
        stands = oracle.active and not oracle.until
        raised = [one for one in (*made, *more) if one.change is Change.RAISED]
        # A raise for each time that the condition stands anew without a hold, and no other.
        assert len(raised) == (stands and not was)
        if raised:
            oracle.seen, oracle.latched = False, True
        assert alarm.active is oracle.active
        assert alarm.held is bool(oracle.until)
        if not oracle.until:
            expected = (
                (ACKNOWLEDGED if oracle.seen else UNACKNOWLEDGED)
                if oracle.active
                else ((LATCHED if oracle.latched else NORMAL) if oracle.seen else RETURNED)
            )
            assert alarm.state is expected
        for one in (*made, *more):
            assert legal(one), one
            assert one.before is shown  # each record goes on where the last one ended
            shown = one.after
            assert one.time_s == now
        assert alarm.state is shown


@given(CONFIGS, histories())
def test_restarts_change_nothing_but_the_delay_that_runs(config: AlarmConfig, history: list[Event]) -> None:
    alarm, now = Alarm(), 0.0
    for event in history:
        now = round(now + event.wait_s, 6)
        alarm, _ = deed(alarm, config, event, now, Oracle(config))
        alarm, _ = tick_alarm(alarm, config, now)
        assert alarm_of(alarm_text(alarm)) == replace(alarm, since_s=None)
