"""What goes out: JSON that its published schema accepts, alarm records as CloudEvents."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import jsonschema
import pytest

from lumpwatch.service.cli.schema import text
from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmState, Change, Hold, Transition
from lumpwatch.service.core.clock import Clocks, utc
from lumpwatch.service.core.decision import AlarmChange, BlindReason, Decision, RoiResult
from lumpwatch.service.core.detection import DetectedObject, Detection
from lumpwatch.service.protocol.messages import AlarmEvent, Heartbeat, RoiBeat
from lumpwatch.service.protocol.records import alarm_event, level_of, state_line, state_message
from tests.service_helpers import frame

SHARES = (("belt", 0.750004), ("fall", 0.249996))
FOUND = DetectedObject(3, 101.2345, 50.0, 30.005, 20.0, 2.0, 3.333, 0.98765432, "belt", SHARES)
RAISED = Transition(Change.RAISED, AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, 100.0)
ALARM = Alarm(active=True, waits=True)
ALARMS = dict.fromkeys(AlarmClass, Alarm()) | {AlarmClass.LUMP: ALARM}
CHANGE = AlarmChange(AlarmClass.LUMP, RAISED, ALARM, "high")
RESULT = RoiResult(
    roi="apron",
    frame=frame(41, time_s=100.0, received_s=100.02),
    decision=Decision.LUMP,
    reason=None,
    detection=Detection(0.98765432, (FOUND,), 850.0, 0.0),
    existence=0.98765432,
    alarms=ALARMS,
    taken_s=100.03,
    prior=4,
    decided=True,
    changes=(CHANGE,),
)
STARTING = RoiResult(
    "apron",
    None,
    Decision.BLIND,
    BlindReason.STARTING,
    None,
    0.0,
    dict.fromkeys(AlarmClass, Alarm()),
    0,
    decided=False,
)
CLOCKS = Clocks(monotonic_s=100.125, wall_s=1_700_000_000.5)
BEAT = Heartbeat(
    site="pit",
    camera="cam",
    seq=7,
    time=utc(1_700_000_000.5),
    valid_s=3.0,
    valid=True,
    rois={
        "apron": RoiBeat(state=Decision.LUMP, decided_ago_s=0.04, decided=utc(1_700_000_000.46), valid=True),
        "chute": RoiBeat(state=Decision.BLIND, decided_ago_s=None, valid=True),
    },
)


def record(line: bytes) -> dict[str, Any]:
    assert b"\n" not in line
    loaded: dict[str, Any] = json.loads(line)
    return loaded


def validator(of: str) -> jsonschema.Draft202012Validator:
    schema = json.loads(text(of))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


EVENT = record(alarm_event(RESULT, CHANGE, "pit", "cam", 12, CLOCKS).line())
RECORDS = {
    "alarm": [
        EVENT,
        record(
            alarm_event(replace(RESULT, detection=None, frame=None), CHANGE, "pit", "cam", 1, CLOCKS).line()
        ),
    ],
    "state": [
        record(state_message(RESULT, "pit", "cam", CLOCKS).line()),
        record(state_message(STARTING, "pit", "cam", CLOCKS).line()),
    ],
    "heartbeat": [record(BEAT.line())],
    "level": [record(level_of(RESULT, 12, 3.0).line()), record(level_of(STARTING, 0, 3.0).line())],
    "replay": [
        record(state_line(RESULT, "cam", 90.0).line()),
        record(state_line(STARTING, "cam", 0.0).line()),
    ],
}


@pytest.mark.parametrize("of", RECORDS)
def test_records_fit_their_published_schema(of: str) -> None:
    for one in RECORDS[of]:
        validator(of).validate(one)


@pytest.mark.parametrize("of", RECORDS)
def test_the_schema_describes_every_field_and_its_type(of: str) -> None:
    check, one = validator(of), RECORDS[of][0]
    assert set(one) == set(check.schema["properties"])
    for field in one:
        assert list(check.iter_errors(one | {field: ["another type"]})), f"{field} may be anything"
        assert check.schema["properties"][field].get("description")


@pytest.mark.parametrize(
    ("of", "needed"),
    [
        ("alarm", {"id", "source", "type", "subject", "time", "data"}),
        pytest.param("alarm", {"specversion"}),
        ("state", {"frame", "time_s", "camera", "roi", "state", "existence", "site", "alarm"}),
        ("heartbeat", {"site", "camera", "seq", "time", "valid_s", "valid"}),
        ("level", {"lump", "blind", "system", "alarm", "blind_alarm", "system_alarm", "sequence", "valid_s"}),
        ("replay", {"frame", "time_s", "camera", "roi", "state", "existence"}),
    ],
)
def test_the_schema_asks_for_what_must_be_there(of: str, needed: set[str]) -> None:
    for field in needed:
        less = {key: value for key, value in RECORDS[of][0].items() if key != field}
        assert list(validator(of).iter_errors(less)), f"{field} may be missing"


def test_readers_take_fields_that_they_do_not_know() -> None:
    for of, records in RECORDS.items():
        validator(of).validate(records[0] | {"added_later": 1})


# Alarm records


def test_an_alarm_record_is_a_cloud_event() -> None:
    assert {key: EVENT[key] for key in ("specversion", "source", "type", "subject", "datacontenttype")} == {
        "specversion": "1.0",
        "source": "/lumpwatch/pit/cam/apron",
        "type": "io.lumpwatch.alarm.raised.v1",
        "subject": "cam/apron",
        "datacontenttype": "application/json",
    }
    assert EVENT["id"]
    assert datetime.fromisoformat(EVENT["time"]) == datetime(2023, 11, 14, 22, 13, 20, 500_000, tzinfo=UTC)
    # CloudEvents 1.0: names of attributes are lower-case letters and digits.
    assert all(name.isalnum() and name.islower() for name in EVENT)


def test_what_an_alarm_record_says() -> None:
    data = EVENT["data"]
    assert {key: data[key] for key in data if key not in ("objects", "timing")} == {
        "site": "pit",
        "camera": "cam",
        "roi": "apron",
        "class": "lump",
        "priority": "high",
        "sequence": 12,
        "change": "raised",
        "state": "UNACKNOWLEDGED",
        "previous": "NORMAL",
        "frame": 42,
        "time_s": 100.0,
        "existence": 0.987654,
        "oversize": None,
        "lip_s": None,
        "left_s": None,
        "lip_reason": "uncalibrated",
        "latency": None,
        "test": False,
        "actor": None,
        "reason": None,
        "until": None,
        "prior": 4,
        "evidence": None,
    }
    assert data["objects"] == [
        {
            "x": 101.23,
            "y": 50.0,
            "w": 30.0,
            "h": 20.0,
            "existence": 0.987654,
            "model": "belt",
            "id": 3,
            "spread_x": 2.0,
            "spread_y": 3.33,
            "model_shares": {"belt": 0.75, "fall": 0.25},
            "wrong_way": False,
            "size": None,
            "counts": True,
            "not_counted": None,
        }
    ]
    assert data["timing"]["age_s"] == 0.125
    assert datetime.fromisoformat(data["timing"]["captured"]) == utc(1_700_000_000.375)
    assert datetime.fromisoformat(data["timing"]["decided"]) == utc(1_700_000_000.5)


def test_who_acknowledged_is_told() -> None:
    acknowledged = Transition(
        Change.ACKNOWLEDGED, AlarmState.UNACKNOWLEDGED, AlarmState.ACKNOWLEDGED, 101.0, "Ada"
    )
    event = alarm_event(RESULT, replace(CHANGE, transition=acknowledged), "pit", "cam", 13, CLOCKS)
    assert event.type == "io.lumpwatch.alarm.acknowledged.v1"
    assert (event.data.change, event.data.actor) == ("acknowledged", "Ada")
    assert (event.data.previous, event.data.state) == ("UNACKNOWLEDGED", "ACKNOWLEDGED")


def test_a_shelving_says_why_and_until_when() -> None:
    shelved = Transition(
        Change.SHELVED, AlarmState.NORMAL, AlarmState.SHELVED, 100.0, "Ada", "dust from the repair"
    )
    change = AlarmChange(
        AlarmClass.BLIND, shelved, Alarm(shelved=Hold("Ada", "dust from the repair", 700.125)), "low"
    )
    event = alarm_event(RESULT, change, "pit", "cam", 14, CLOCKS)
    assert event.type == "io.lumpwatch.alarm.shelved.v1"
    assert (event.data.alarm_class, event.data.priority, event.data.reason) == (
        AlarmClass.BLIND,
        "low",
        "dust from the repair",
    )
    assert event.data.until == utc(1_700_000_600.5)  # 600 s after CLOCKS on the wall clock
    assert record(event.line())["data"]["class"] == "blind"
    assert AlarmEvent.model_validate_json(event.line()) == event


def test_records_of_before_there_were_classes_are_read() -> None:
    old = {k: v for k, v in EVENT["data"].items() if k not in ("class", "priority", "sequence", "reason")}
    event = AlarmEvent.model_validate({**EVENT, "data": old})
    assert (event.data.alarm_class, event.data.sequence) == (AlarmClass.LUMP, 0)


def test_a_level_is_small_and_says_the_least() -> None:
    line = level_of(
        replace(RESULT, alarms=ALARMS | {AlarmClass.LUMP: Alarm(active=True, shelved=Hold("Ada", "dust"))}),
        7,
        3.0,
    ).line()
    assert record(line) == {
        "lump": 1,
        "blind": 0,
        "system": 0,
        "alarm": "SHELVED",
        "blind_alarm": "NORMAL",
        "system_alarm": "NORMAL",
        "blocked": 0,
        "blocked_alarm": "NORMAL",
        "feed": "unknown",
        "sequence": 7,
        "valid_s": 3.0,
    }
    assert len(line) < 220
    assert record(level_of(STARTING, 0, 3.0).line())["blind"] == 1


def test_ids_rise_with_time_and_number() -> None:
    moments = [(1, 0.0), (2, 0.0), (3, 9.9), (4, 1e9), (5, 1.7e9), (6, 1.7e9)]
    ids = [alarm_event(RESULT, CHANGE, "pit", "cam", n, Clocks(100.0, wall)).id for n, wall in moments]
    assert ids == sorted(set(ids))


# States


def test_a_state_line_has_the_fields_of_the_contract() -> None:
    line = record(state_line(RESULT, "cam", 90.0).line())
    assert {
        "frame",
        "time_s",
        "camera",
        "roi",
        "state",
        "existence",
        "oversize",
        "objects",
        "unlocated",
        "feed",
        "blockage",
        "reason",
    } == set(line)
    assert (line["frame"], line["time_s"], line["state"]) == (42, 10.0, "LUMP")
    assert {"x", "y", "w", "h", "existence", "model", "id"} <= set(line["objects"][0])


def test_a_state_before_the_first_frame() -> None:
    state = record(state_message(STARTING, "pit", "cam", CLOCKS).line())
    assert (state["frame"], state["state"], state["reason"]) == (0, "BLIND", "starting")
    assert (state["timing"], state["objects"], state["alarm"]) == (None, [], "NORMAL")
