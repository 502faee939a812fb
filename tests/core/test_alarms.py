"""The alarm's state machine: by hand, against a brute-force reading of its history, and as properties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.core.alarm import Alarm, AlarmState, Change, Transition, acknowledge, step_alarm

NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED, LATCHED, SHELVED, SUPPRESSED, OUT = AlarmState
CONFIG = AlarmConfig(raise_above=0.9, clear_below=0.5, on_delay_s=0.2, off_delay_s=1.0, latch=True)


def run(
    config: AlarmConfig, existences: Sequence[tuple[float, float]], start: Alarm | None = None
) -> tuple[Alarm, list[Transition]]:
    """Feed (time, existence) one by one."""
    alarm = start or Alarm()
    changes = []
    for time_s, existence in existences:
        alarm, change = step_alarm(alarm, config, existence, time_s)
        if change is not None:
            changes.append(change)
    return alarm, changes


def at(state: AlarmState, **more: Any) -> Alarm:
    """An alarm without holds in that state."""
    active, waits = state.active, state in (UNACKNOWLEDGED, RETURNED)
    alarm = Alarm(active, waits, **more)
    assert alarm.state is state
    return alarm


# Transitions by hand; with delays of zero one frame decides


@pytest.mark.parametrize("latch", [True, False])
@pytest.mark.parametrize(
    ("before", "existence", "after", "change"),
    [
        (NORMAL, 0.95, UNACKNOWLEDGED, Change.RAISED),
        (NORMAL, 0.9, NORMAL, None),
        (NORMAL, 0.0, NORMAL, None),
        (UNACKNOWLEDGED, 0.95, UNACKNOWLEDGED, None),
        (UNACKNOWLEDGED, 0.7, UNACKNOWLEDGED, None),
        (UNACKNOWLEDGED, 0.5, UNACKNOWLEDGED, None),
        (UNACKNOWLEDGED, 0.49, "latched", Change.CLEARED),
        (ACKNOWLEDGED, 0.95, ACKNOWLEDGED, None),
        (ACKNOWLEDGED, 0.5, ACKNOWLEDGED, None),
        (ACKNOWLEDGED, 0.49, NORMAL, Change.CLEARED),
        (RETURNED, 0.49, RETURNED, None),
        (RETURNED, 0.9, RETURNED, None),
        (RETURNED, 0.95, UNACKNOWLEDGED, Change.RAISED),
    ],
)
def test_transitions_by_existence(
    latch: bool, before: AlarmState, existence: float, after: AlarmState | str, change: Change | None
) -> None:
    config = AlarmConfig(on_delay_s=0.0, off_delay_s=0.0, latch=latch)
    expected = (RETURNED if latch else NORMAL) if after == "latched" else after
    alarm, made = step_alarm(at(before), config, existence, 7.0)
    assert alarm.state is expected
    if change is None:
        assert made is None
    else:
        assert isinstance(expected, AlarmState)
        assert made == Transition(change, before, expected, 7.0)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (NORMAL, None),
        (UNACKNOWLEDGED, ACKNOWLEDGED),
        (ACKNOWLEDGED, None),
        (RETURNED, NORMAL),
    ],
)
def test_acknowledging(before: AlarmState, after: AlarmState | None) -> None:
    alarm, made = acknowledge(at(before, since_s=4.0), "Ada", 5.0)
    if after is None:
        assert made is None
        assert alarm == at(before, since_s=4.0)
    else:
        assert made == Transition(Change.ACKNOWLEDGED, before, after, 5.0, "Ada")
        assert alarm == at(after, since_s=4.0, actor="Ada")


def test_active_means_that_the_lump_is_there() -> None:
    assert [state.active for state in (NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED)] == [
        False,
        True,
        True,
        False,
    ]


# Delays


@pytest.mark.parametrize("fps", [5, 10, 15, 25, 29.97, 30, 50, 60])
@pytest.mark.parametrize("delay_s", [0.0, 0.2, 0.5, 2.0])
@pytest.mark.parametrize("start_s", [0.0, 86_400.1])
def test_delays_hold_at_any_frame_rate(fps: float, delay_s: float, start_s: float) -> None:
    config = AlarmConfig(on_delay_s=delay_s, off_delay_s=delay_s)
    times = [start_s + k / fps for k in range(round(3 * fps))]
    _, raised = run(config, [(t, 1.0) for t in times])
    assert [change.change for change in raised] == [Change.RAISED]
    # The first frame that is `delay_s` after the first crossing, give or take rounding of the times.
    assert delay_s - 2e-6 <= raised[0].time_s - start_s < delay_s + 1 / fps - 1e-7
    _, cleared = run(config, [(t, 0.0) for t in times], at(ACKNOWLEDGED))
    assert cleared[0].time_s == raised[0].time_s


def test_a_break_starts_the_delay_anew() -> None:
    existences = [(0.0, 1.0), (0.1, 1.0), (0.15, 0.9), (0.25, 1.0), (0.35, 1.0), (0.45, 1.0)]
    _, changes = run(CONFIG, existences)
    assert [(c.change, c.time_s) for c in changes] == [(Change.RAISED, 0.45)]


def test_between_the_thresholds_nothing_changes() -> None:
    existences = [(k / 10, 0.7) for k in range(100)]
    for state in (NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED):
        alarm, changes = run(CONFIG, existences, at(state))
        assert (alarm.state, changes) == (state, [])


def test_acknowledging_does_not_delay_the_clearing() -> None:
    alarm, _ = run(CONFIG, [(0.0, 0.1), (0.5, 0.1)], at(UNACKNOWLEDGED))
    alarm, _ = acknowledge(alarm, "Ada", 0.6)
    _, changes = run(CONFIG, [(0.9, 0.1), (1.0, 0.1)], alarm)
    assert [(c.change, c.time_s, c.after) for c in changes] == [(Change.CLEARED, 1.0, NORMAL)]


def test_a_whole_life() -> None:
    alarm, made = run(CONFIG, [(0.0, 0.95), (0.2, 0.95), (0.3, 0.2), (1.3, 0.2)])
    assert [(c.change, c.before, c.after, c.time_s) for c in made] == [
        (Change.RAISED, NORMAL, UNACKNOWLEDGED, 0.2),
        (Change.CLEARED, UNACKNOWLEDGED, RETURNED, 1.3),
    ]
    alarm, made = run(CONFIG, [(2.0, 0.95), (2.2, 0.95)], alarm)  # a second lump before anyone looked
    assert [(c.before, c.after) for c in made] == [(RETURNED, UNACKNOWLEDGED)]
    alarm, _ = acknowledge(alarm, "Ada", 2.3)
    alarm, made = run(CONFIG, [(2.4, 0.0), (3.4, 0.0)], alarm)
    assert [(c.change, c.after) for c in made] == [(Change.CLEARED, NORMAL)]
    assert alarm == Alarm()


# Properties


@dataclass(frozen=True)
class Event:
    """A frame with an existence, or, where that is None, an acknowledgement."""

    time_s: float
    existence: float | None


@st.composite
def histories(draw: st.DrawFn) -> list[Event]:
    """Up to 120 frames at some 5 to 60 a second, with phases of high and low existence."""
    interval = 1 / draw(st.sampled_from([5, 12, 25, 60]))
    levels = st.sampled_from([0.0, 0.3, 0.49, 0.5, 0.6, 0.9, 0.91, 1.0]) | st.floats(0, 1)
    time_s, events = 0.0, []
    for level, length, acknowledged in draw(
        st.lists(st.tuples(levels, st.integers(1, 20), st.booleans()), max_size=10)
    ):
        for _ in range(length):
            time_s += interval
            events.append(Event(time_s, level))
        if acknowledged:
            events.append(Event(time_s, None))
    return events


CONFIGS = st.builds(
    AlarmConfig,
    raise_above=st.sampled_from([0.9, 0.6, 1.0]),
    clear_below=st.sampled_from([0.5, 0.3, 0.0]),
    on_delay_s=st.sampled_from([0.0, 0.07, 0.2, 1.0]),
    off_delay_s=st.sampled_from([0.0, 0.1, 0.5]),
    latch=st.booleans(),
)


def play(config: AlarmConfig, events: list[Event]) -> list[Transition]:
    alarm = Alarm()
    made = []
    for event in events:
        if event.existence is None:
            alarm, change = acknowledge(alarm, "Ada", event.time_s)
        else:
            alarm, change = step_alarm(alarm, config, event.existence, event.time_s)
        if change is not None:
            made.append(change)
            assert change.after is alarm.state
    return made


def _beyond(config: AlarmConfig, existence: float, active: bool) -> bool:
    return existence < config.clear_below if active else existence > config.raise_above


def conditions(config: AlarmConfig, events: list[Event]) -> list[tuple[Change, float]]:
    """Raised and cleared, read off the whole history of frames at each frame."""
    frames = [(e.time_s, e.existence) for e in events if e.existence is not None]
    active, changes = False, []
    for k, (now, _) in enumerate(frames):
        first = k
        while first >= 0 and _beyond(config, frames[first][1], active):
            first -= 1
        delay = config.off_delay_s if active else config.on_delay_s
        if first < k and now - frames[first + 1][0] >= delay - 1e-6:
            active = not active
            changes.append((Change.RAISED if active else Change.CLEARED, now))
    return changes


@settings(deadline=None)
@given(CONFIGS, histories())
def test_raised_and_cleared_as_the_history_says(config: AlarmConfig, events: list[Event]) -> None:
    made = [(c.change, c.time_s) for c in play(config, events) if c.change is not Change.ACKNOWLEDGED]
    assert made == conditions(config, events)


@settings(deadline=None)
@given(CONFIGS, histories())
def test_transitions_follow_from_one_another(config: AlarmConfig, events: list[Event]) -> None:
    made = play(config, events)
    state = NORMAL
    for change in made:
        assert change.before is state
        assert change.after is not state
        state = change.after
        assert (change.actor == "Ada") is (change.change is Change.ACKNOWLEDGED)
        if not config.latch:
            assert change.after is not RETURNED
    conditional = [c.change for c in made if c.change is not Change.ACKNOWLEDGED]
    assert conditional == [Change.RAISED, Change.CLEARED] * (len(conditional) // 2) + [Change.RAISED] * (
        len(conditional) % 2
    )


@settings(deadline=None)
@given(CONFIGS, histories())
def test_never_raised_without_existence(config: AlarmConfig, events: list[Event]) -> None:
    low = [
        Event(e.time_s, None if e.existence is None else min(e.existence, config.raise_above)) for e in events
    ]
    assert play(config, low) == []


@settings(deadline=None)
@given(CONFIGS, histories())
def test_the_same_sequence_gives_the_same_transitions(config: AlarmConfig, events: list[Event]) -> None:
    assert play(config, events) == play(config, list(events))
