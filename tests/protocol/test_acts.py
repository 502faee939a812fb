"""From the parameters of a query to what happens to an alarm, and clear errors for anything else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.bus.keys import Kind
from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmRequestError, AlarmState, Change
from lumpwatch.service.protocol.commands import act_of, read

CONFIG = AlarmConfig(shelve_max_s=100.0, suppress_max_s=50.0)
WAITING = Alarm(active=True, waits=True)
ADA = {"actor": "Ada"}


def done(kind: Kind, parameters: dict[str, str], alarm: Alarm = WAITING) -> tuple[Alarm, list[Change]]:
    _, act = act_of(kind, parameters)
    after, made = act(alarm, CONFIG, 10.0)
    return after, [one.change for one in made]


@pytest.mark.parametrize(
    ("kind", "parameters", "state", "change"),
    [
        (Kind.ACK, ADA, AlarmState.ACKNOWLEDGED, Change.ACKNOWLEDGED),
        (Kind.SHELVE, {**ADA, "reason": "dust", "for_s": "60"}, AlarmState.SHELVED, Change.SHELVED),
        (Kind.SERVICE, {**ADA, "reason": "x", "state": "out"}, AlarmState.OUT_OF_SERVICE, Change.TAKEN_OUT),
        (Kind.SUPPRESS, {"signal": "feeder", "valid_s": "9.5"}, AlarmState.SUPPRESSED, Change.SUPPRESSED),
    ],
)
def test_what_is_asked_is_done(
    kind: Kind, parameters: dict[str, str], state: AlarmState, change: Change
) -> None:
    alarm, changes = done(kind, parameters)
    assert (alarm.state, changes) == (state, [change])


def test_holds_are_ended() -> None:
    shelved, _ = done(Kind.SHELVE, {**ADA, "reason": "dust", "for_s": "60"})
    assert done(Kind.UNSHELVE, ADA, shelved)[1] == [Change.UNSHELVED, Change.RAISED]
    out, _ = done(Kind.SERVICE, {**ADA, "reason": "x", "state": "out"})
    assert done(Kind.SERVICE, {**ADA, "state": "in"}, out)[1] == [Change.PUT_BACK, Change.RAISED]
    suppressed, _ = done(Kind.SUPPRESS, {"signal": "feeder", "valid_s": "9"})
    assert done(Kind.SUPPRESS, {"signal": "feeder", "valid_s": "0"}, suppressed)[1] == [
        Change.UNSUPPRESSED,
        Change.RAISED,
    ]


def test_what_is_latched_is_reset_by_someone() -> None:
    latched = Alarm(latched=True)
    assert latched.state is AlarmState.LATCHED
    alarm, changes = done(Kind.RESET, ADA, latched)
    assert (alarm.state, changes) == (AlarmState.NORMAL, [Change.RESET])
    assert done(Kind.RESET, ADA)[1] == []  # the lump is there


def test_the_class_is_lump_unless_said() -> None:
    assert act_of(Kind.ACK, ADA)[0] is AlarmClass.LUMP
    assert act_of(Kind.ACK, {**ADA, "class": "blind"})[0] is AlarmClass.BLIND


@pytest.mark.parametrize(
    ("kind", "parameters", "told"),
    [
        (Kind.ACK, {}, "actor: is missing"),
        (Kind.ACK, {"actor": "  "}, "actor: is missing"),
        (Kind.ACK, {**ADA, "clas": "blind"}, "clas: is no parameter of ack (has actor, class)"),
        (Kind.ACK, {**ADA, "class": "dust"}, "class: 'dust' is none of lump, blind, system"),
        (Kind.RESET, {}, "actor: is missing"),
        (Kind.SHELVE, {**ADA, "for_s": "60"}, "reason: is missing"),
        (Kind.SHELVE, {**ADA, "reason": "x"}, "for_s: is missing"),
        (Kind.SHELVE, {**ADA, "reason": "x", "for_s": "1h"}, "for_s: '1h' is not a number of seconds"),
        (Kind.SHELVE, {**ADA, "reason": "x", "for_s": "101"}, "for_s: 101 is not above 0 and at most 100"),
        (Kind.SHELVE, {**ADA, "reason": "x", "for_s": "nan"}, "for_s: nan is not above 0"),
        (Kind.SERVICE, {**ADA, "state": "out"}, "reason: is missing"),
        (Kind.SERVICE, {**ADA, "state": "off"}, "state: 'off' is neither in nor out"),
        (Kind.SUPPRESS, {"valid_s": "9"}, "signal: is missing"),
        (Kind.SUPPRESS, {"signal": "feeder", "valid_s": "-1"}, "valid_s: -1 is not above 0"),
        (Kind.SUPPRESS, {"signal": "feeder", "valid_s": "51"}, "at most 50 seconds"),
    ],
)
def test_bad_parameters_are_named(kind: Kind, parameters: dict[str, str], told: str) -> None:
    with pytest.raises(AlarmRequestError) as caught:
        done(kind, parameters)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_and_reasons_are_one_line_and_not_endless() -> None:
    asked = {"actor": "Ada\n Lovelace" + "x" * 999, "reason": "a\tb" + "y" * 999, "for_s": "9"}
    alarm, _ = done(Kind.SHELVE, asked)
    assert alarm.shelved is not None
    assert alarm.shelved.actor.startswith("Ada Lovelacexx")
    assert (len(alarm.shelved.actor), len(alarm.shelved.reason)) == (128, 500)


def test_a_payload_carries_parameters_too() -> None:
    assert read({}, b'{"signal": "feeder", "valid_s": 9.5}') == {"signal": "feeder", "valid_s": "9.5"}
    assert read({"valid_s": "5"}, b'{"valid_s": 9}') == {"valid_s": "5"}
    assert read({"actor": "Ada"}, None) == {"actor": "Ada"}


@given(st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_any_payload_is_read_or_refused(payload: bytes) -> None:
    try:
        found = read({}, payload)
    except AlarmRequestError:
        return
    assert all(isinstance(value, str) for value in found.values())


@given(
    st.sampled_from([Kind.ACK, Kind.RESET, Kind.SHELVE, Kind.UNSHELVE, Kind.SERVICE, Kind.SUPPRESS]),
    st.dictionaries(
        st.sampled_from(["actor", "reason", "for_s", "state", "signal", "valid_s", "class"]),
        st.text(max_size=8) | st.sampled_from(["1", "out", "in", "lump"]),
    ),
)
def test_any_parameters_are_done_or_refused(kind: Kind, parameters: dict[str, str]) -> None:
    try:
        alarm, _ = done(kind, parameters)
    except AlarmRequestError:
        return
    assert alarm.active
