"""From the parameters of a query to what happens to an alarm, and clear errors for anything else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmRequestError, AlarmState, Change
from lumpwatch.service.protocol import COMMANDS, AlarmRequest, VerdictRequest, read_request
from lumpwatch.service.protocol.commands import AckRequest, SuppressRequest

CONFIG = AlarmConfig(shelve_max_s=100.0, suppress_max_s=50.0)
WAITING = Alarm(active=True, waits=True)
ADA = {"actor": "Ada"}


def request(name: str, parameters: dict[str, str], payload: bytes | None = None) -> AlarmRequest:
    asked = read_request(COMMANDS[name].request, parameters, payload)
    assert isinstance(asked, AlarmRequest)
    return asked


def done(name: str, parameters: dict[str, str], alarm: Alarm = WAITING) -> tuple[Alarm, list[Change]]:
    make = COMMANDS[name].action
    assert make is not None
    after, made = make(request(name, parameters))(alarm, CONFIG, 10.0)
    return after, [one.change for one in made]


@pytest.mark.parametrize(
    ("name", "parameters", "state", "change"),
    [
        ("ack", ADA, AlarmState.ACKNOWLEDGED, Change.ACKNOWLEDGED),
        ("shelve", {**ADA, "reason": "dust", "for_s": "60"}, AlarmState.SHELVED, Change.SHELVED),
        ("service", {**ADA, "reason": "x", "state": "out"}, AlarmState.OUT_OF_SERVICE, Change.TAKEN_OUT),
        ("suppress", {"signal": "feeder", "valid_s": "9.5"}, AlarmState.SUPPRESSED, Change.SUPPRESSED),
    ],
)
def test_what_is_asked_is_done(
    name: str, parameters: dict[str, str], state: AlarmState, change: Change
) -> None:
    alarm, changes = done(name, parameters)
    assert (alarm.state, changes) == (state, [change])


def test_holds_are_ended() -> None:
    shelved, _ = done("shelve", {**ADA, "reason": "dust", "for_s": "60"})
    assert done("unshelve", ADA, shelved)[1] == [Change.UNSHELVED, Change.RAISED]
    out, _ = done("service", {**ADA, "reason": "x", "state": "out"})
    assert done("service", {**ADA, "state": "in"}, out)[1] == [Change.PUT_BACK, Change.RAISED]
    suppressed, _ = done("suppress", {"signal": "feeder", "valid_s": "9"})
    assert done("suppress", {"signal": "feeder", "valid_s": "0"}, suppressed)[1] == [
        Change.UNSUPPRESSED,
        Change.RAISED,
    ]


def test_what_is_latched_is_reset_by_someone() -> None:
    latched = Alarm(latched=True)
    assert latched.state is AlarmState.LATCHED
    alarm, changes = done("reset", ADA, latched)
    assert (alarm.state, changes) == (AlarmState.NORMAL, [Change.RESET])
    assert done("reset", ADA)[1] == []  # the lump is there


def test_the_class_is_lump_unless_said() -> None:
    assert request("ack", ADA).alarm_class is AlarmClass.LUMP
    assert request("ack", {**ADA, "class": "blind"}).alarm_class is AlarmClass.BLIND


@pytest.mark.parametrize(
    ("name", "parameters", "told"),
    [
        ("ack", {}, "actor: is missing"),
        ("ack", {"actor": "  "}, "actor: is missing"),
        ("ack", {**ADA, "clas": "blind"}, "clas: is no parameter"),
        ("ack", {**ADA, "class": "dust"}, "class: "),
        ("reset", {}, "actor: is missing"),
        ("shelve", {**ADA, "for_s": "60"}, "reason: is missing"),
        ("shelve", {**ADA, "reason": "x"}, "for_s: is missing"),
        ("shelve", {**ADA, "reason": "x", "for_s": "1h"}, "for_s: "),
        ("shelve", {**ADA, "reason": "x", "for_s": "101"}, "for_s: 101 "),
        ("shelve", {**ADA, "reason": "x", "for_s": "nan"}, "for_s: "),
        ("service", {**ADA, "state": "out"}, "reason: is missing"),
        ("service", {**ADA, "state": "off"}, "state: "),
        ("suppress", {"valid_s": "9"}, "signal: is missing"),
        ("suppress", {"signal": "feeder", "valid_s": "-1"}, "valid_s: "),
        ("suppress", {"signal": "feeder", "valid_s": "51"}, "at most 50 seconds"),
    ],
)
def test_bad_parameters_are_named(name: str, parameters: dict[str, str], told: str) -> None:
    with pytest.raises(AlarmRequestError) as caught:
        done(name, parameters)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_and_reasons_are_one_line() -> None:
    asked = {"actor": " Ada\n Lovelace", "reason": "a\tb", "for_s": "9"}
    alarm, _ = done("shelve", asked)
    assert alarm.shelved is not None
    assert (alarm.shelved.actor, alarm.shelved.reason) == ("Ada Lovelace", "a b")


LONG = [
    (name, field, limits["maxLength"])
    for name, row in COMMANDS.items()
    for field, schema in row.request.model_json_schema(by_alias=True)["properties"].items()
    for limits in (schema, *schema.get("anyOf", ()))
    if "maxLength" in limits
]


@pytest.mark.parametrize(("name", "field", "longest"), LONG)
def test_the_daemon_takes_what_the_schema_says_and_no_more(name: str, field: str, longest: int) -> None:
    """It once cut in silence what the schema refuses."""
    example = COMMANDS[name].example.model_dump(mode="json", by_alias=True, exclude_none=True)
    example = example if field != "evidence" else example | {"alarm": None}
    fits = read_request(COMMANDS[name].request, example | {field: longest * "x"})
    assert getattr(fits, field) == longest * "x"
    with pytest.raises(AlarmRequestError, match=f"^{field}: "):
        read_request(COMMANDS[name].request, example | {field: (longest + 1) * "x"})


@pytest.mark.parametrize(
    "payload", [rb'{"actor": "\ud800"}', b'{"actor": "\xff"}', b"\xff\xfe", 99_999 * b"["]
)
def test_a_payload_that_is_not_utf8_is_refused(payload: bytes) -> None:
    with pytest.raises(AlarmRequestError, match="payload"):
        request("ack", {}, payload)


def test_half_a_surrogate_pair_is_refused_wherever_it_comes_from() -> None:
    with pytest.raises(AlarmRequestError, match=r"^actor: "):
        request("ack", {"actor": "\ud800"})
    with pytest.raises(AlarmRequestError, match=r"^note: "):
        read_request(VerdictRequest, {"actor": "Ada", "verdict": "true", "note": "\ud800"})


def test_a_payload_carries_parameters_too() -> None:
    asked = request("suppress", {}, b'{"signal": "feeder", "valid_s": 9.5}')
    assert asked == SuppressRequest(signal="feeder", valid_s=9.5)
    assert request("suppress", {"valid_s": "5"}, b'{"signal": "a", "valid_s": 9}') == SuppressRequest(
        signal="a", valid_s=5.0
    )
    assert request("ack", ADA, None) == AckRequest(actor="Ada")
    assert read_request(VerdictRequest, {}, b'{"actor": "Ada", "verdict": "true", "alarm": 12}').alarm == 12


def test_the_requests_of_the_table_are_immutable_and_their_own_examples() -> None:
    for name, row in COMMANDS.items():
        told = row.example.model_dump(mode="json", by_alias=True, exclude_none=True)
        assert row.name == name
        assert read_request(row.request, told) == row.example


@given(st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_any_payload_is_read_or_refused(payload: bytes) -> None:
    try:
        found = request("ack", {}, payload)
    except AlarmRequestError:
        return
    assert isinstance(found, AckRequest)


@given(
    st.sampled_from(sorted(name for name, row in COMMANDS.items() if row.action is not None)),
    st.dictionaries(
        st.sampled_from(["actor", "reason", "for_s", "state", "signal", "valid_s", "class"]),
        st.text(st.characters(exclude_categories=()), max_size=8)
        | st.sampled_from(["1", "out", "in", "lump"]),
    ),
)
def test_any_parameters_are_done_or_refused(name: str, parameters: dict[str, str]) -> None:
    try:
        alarm, _ = done(name, parameters)
    except AlarmRequestError:
        return
    assert alarm.active
