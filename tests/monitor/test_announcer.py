"""What goes out for a result, in which order, and how often."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from lumpwatch.service.bus.ordering import Message
from lumpwatch.service.core.alarm import AlarmClass, Change
from lumpwatch.service.core.clock import Clocks
from lumpwatch.service.core.detection import Detection, LumpSize
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.monitor.alarm_record import RecordError
from lumpwatch.service.monitor.announcer import LEVEL_EVERY_S, Announcer
from lumpwatch.service.monitor.effects import Confirm, Count, KeepEvidence, Publish, Write
from lumpwatch.service.storage.event_log import Entry, KeptRecord
from lumpwatch.service.storage.event_notes import Note
from lumpwatch.service.telemetry import MonitorMetrics
from tests.protocol.test_messages import FOUND, RESULT, STARTING
from tests.service_helpers import camera, frame

STILL = replace(RESULT, changes=())


class World:
    """The bus and the event log: remembers what came where, in order."""

    def __init__(self, *, sequences: dict[str, int] | None = None) -> None:
        self.seen: list[tuple[str, Any]] = []
        self.unpublished: list[tuple[str, str, bytes]] = []
        self.records: list[KeptRecord] = []
        self.past: list[Message] = []
        self._sequences = sequences or {}
        self.connected = True
        self.flushed = True

    def sequences(self) -> dict[str, int]:
        return self._sequences

    def write(self, entries: Sequence[Entry]) -> bool:
        self.seen.append(("log", [entry.event for entry in entries]))
        return True

    def add(self, notes: Sequence[Note], *, wait: bool) -> bool:
        self.seen.append(("notes", list(notes)))
        return wait

    def published(self, sent: Sequence[tuple[str, str]]) -> None:
        self.seen.append(("sent", list(sent)))

    def publisher(self, key: str) -> Channel:
        return Channel(self, key.rpartition("/")[2])

    def alarm_publisher(self, key: str, kept: Sequence[Message]) -> Channel:
        self.past += kept
        return self.publisher(key)

    def of(self, where: str) -> list[Any]:
        return [what for place, what in self.seen if place == where]


class Channel:
    """One key of the bus."""

    name = "5a" * 8

    def __init__(self, world: World, name: str) -> None:
        self._world = world
        self._name = name

    def put(self, payload: bytes, number: int | None = None, publisher: str | None = None) -> None:
        self._world.seen.append((self._name, json.loads(payload)))
        if publisher is not None:
            self._world.seen.append(("again", (publisher, number)))


class Now:
    """Clocks that a test sets."""

    def __init__(self) -> None:
        self.monotonic_s = 100.125

    def __call__(self) -> Clocks:
        return Clocks(self.monotonic_s, 1.7e9 + self.monotonic_s)


class AllEvidence:
    """Wants evidence of everything."""

    def __init__(self) -> None:
        self.begun: list[Trigger] = []

    def wants(self, trigger: Trigger) -> bool:
        return True

    def begin(self, trigger: Trigger) -> bool:
        self.begun.append(trigger)
        return True


def announcer(world: World, now: Now | None = None, evidence: AllEvidence | None = None) -> Announcer:
    metrics = MonitorMetrics(CollectorRegistry(), "cam", ("apron",))
    bus: Any = world
    events: Any = world
    return Announcer(
        site="pit",
        camera=camera(),
        bus=bus,
        events=events,
        metrics=metrics,
        clock="boot",
        clocks=now or Now(),
        evidence=evidence,
    )


def test_an_alarm_is_in_the_log_before_it_is_on_the_bus() -> None:
    world = World(sequences={"apron": 7})
    target = announcer(world)
    target.announce((RESULT,))
    assert [place for place, _ in world.seen] == ["log", "alarm", "sent", "state", "level"]
    (event,), record = world.of("log")[0], world.of("alarm")[0]
    assert (event.sequence, record["data"]["sequence"], target.sequence("apron")) == (8, 8, 8)
    assert (event.id, event.change, event.before, event.after) == (
        record["id"],
        "raised",
        "NORMAL",
        "UNACKNOWLEDGED",
    )
    assert (event.camera, event.roi, event.alarm_class, event.frame, event.existence) == (
        "cam",
        "apron",
        AlarmClass.LUMP,
        42,
        0.987654,
    )
    assert (event.monotonic_s, event.clock, event.alarm) == (100.125, "boot", RESULT.alarm)
    assert world.of("sent") == [[("apron", record["id"])]]
    assert world.of("state")[0]["sequence"] == 8
    assert world.of("level")[0]["sequence"] == 8


def test_without_a_change_nothing_is_written() -> None:
    world = World()
    announcer(world).announce((STILL,))
    assert [place for place, _ in world.seen] == ["state", "level"]


def test_sequences_count_each_roi_by_itself() -> None:
    world = World(sequences={"gone": 3})
    target = announcer(world)
    target.announce((replace(RESULT, changes=(*RESULT.changes, *RESULT.changes)),))
    target.announce((RESULT,))
    assert [one["data"]["sequence"] for one in world.of("alarm")] == [1, 2, 3]
    assert [len(batch) for batch in world.of("log")] == [2, 1]


def test_what_the_last_process_may_not_have_sent_is_sent_as_it_was() -> None:
    world = World()
    record = json.dumps({"id": "a", "data": {"sequence": 4}}).encode()
    world.unpublished = [("gone", "z", b"{}"), ("apron", "a", record)]
    announcer(world).send_again()
    assert world.seen == [
        ("alarm", json.loads(record)),
        ("sent", [("gone", "z"), ("apron", "a")]),
    ]


def test_what_is_sent_without_a_hub_is_published_some_time_after_it_is_back() -> None:
    world = World()
    target = announcer(world)
    world.connected = False
    target.announce((RESULT,))
    target.confirm()
    world.connected = True
    target.confirm()
    assert world.of("sent") == []  # subscribers may not have fetched it yet
    target.confirm()
    target.confirm()
    ((sent,),) = world.of("sent")
    assert sent == ("apron", world.of("alarm")[0]["id"])
    target.announce((RESULT,))
    target.confirm()
    assert len(world.of("sent")) == 2
    world.flushed = False  # the hub does not take it
    target.announce((RESULT,))
    target.confirm()
    assert len(world.of("sent")) == 2


def test_what_is_sent_again_without_a_hub_is_not_published_yet() -> None:
    world = World()
    world.unpublished = [("apron", "a", b"{}")]
    world.connected = False
    announcer(world).send_again()
    assert world.of("alarm") == [{}]
    assert world.of("sent") == []


def test_a_level_is_sent_when_it_changes_and_now_and_then() -> None:
    world, now = World(), Now()
    target = announcer(world, now)
    began = now.monotonic_s
    for k in range(100):  # 25 frames a second
        now.monotonic_s = began + k * 0.04
        target.announce((STILL,))
    levels = world.of("level")
    assert len(world.of("state")) == 100
    assert 3.96 / LEVEL_EVERY_S <= len(levels) <= 3.96 / LEVEL_EVERY_S + 1
    now.monotonic_s += 0.04
    target.announce((STARTING,))
    assert len(world.of("level")) == len(levels) + 1
    assert world.of("level")[-1]["blind"] == 1


@pytest.mark.parametrize("field", ["lump", "blind", "alarm", "blind_alarm", "sequence", "valid_s"])
def test_a_level_has_all_that_a_gateway_needs(field: str) -> None:
    world = World()
    announcer(world).announce((RESULT,))
    assert field in world.of("level")[0]


def test_an_alarm_says_what_each_stage_took_and_why_the_lip_is_not_known() -> None:
    world, now = World(), Now()
    announcer(world, now).announce((RESULT,))
    data = world.of("alarm")[0]["data"]
    assert data["latency"] == pytest.approx(
        {
            "receive_s": 0.02,
            "bus_s": 0.01,
            "decision_s": 0.095,
            "publish_s": 0.0,
            "total_s": 0.125,
            "budget_s": 1.0,
        }
    )
    assert (data["lip_s"], data["left_s"], data["lip_reason"]) == (None, None, "uncalibrated")


def test_the_seconds_that_are_left_are_those_after_the_decision() -> None:
    size = LumpSize(speed_m_s=0.4, distance_m=2.0, lip_s=5.0, lip_spread_s=0.2)
    found = replace(FOUND, size=size)
    world = World()
    target = announcer(world)
    target.announce((replace(RESULT, detection=Detection(0.98, (found,), 850.0, 0.0, 0.9)),))
    still = replace(found, size=replace(size, lip_s=None))
    target.announce((replace(RESULT, detection=Detection(0.98, (still,), 850.0, 0.0, 0.9)),))
    target.announce((replace(RESULT, detection=Detection(0.1, (), 850.0, 0.0, 0.0)),))
    told = [
        (one["data"]["lip_s"], one["data"]["left_s"], one["data"]["lip_reason"]) for one in world.of("alarm")
    ]
    assert told == [(5.0, 4.88, None), (None, None, "not_moving"), (None, None, "no_object")]


def test_what_former_processes_sent_is_there_for_late_joiners_and_keeps_its_name() -> None:
    world = World()
    lines = [json.dumps({"id": name}).encode() for name in "abc"]
    world.records = [
        KeptRecord("apron", "a", "0" * 16, 3, lines[0]),
        KeptRecord("gone", "x", "1" * 16, 9, b"{}"),
        KeptRecord("apron", "b", "0" * 16, 4, lines[1]),
    ]
    world.unpublished = [("apron", "b", lines[1])]
    target = announcer(world)
    assert [(one.payload, one.publisher, one.number) for one in world.past] == [(lines[0], "0" * 16, 3)]
    target.send_again()
    assert world.of("again") == [("0" * 16, 4)]


def test_decisions_that_are_late_for_long_are_told() -> None:
    world, now = World(), Now()
    target = announcer(world, now)
    for k in range(60):
        now.monotonic_s = 101.2 + k / 10
        target.announce((replace(STILL, frame=frame(k, time_s=100.0 + k / 10)),))  # 1.2 s late
        assert target.late("apron") == (k >= 50)


def test_what_a_change_sets_off_is_planned_before_anything_happens() -> None:
    world, now = World(sequences={"apron": 7}), Now()
    target = announcer(world, now, AllEvidence())
    keep, write, publish, count, confirm = target.plan((RESULT,), now())
    assert world.seen == []
    assert target.sequence("apron") == 7
    (change,) = RESULT.changes
    name = f"{round(now().wall_s * 1000):015d}-000008"
    trigger = Trigger(name, "apron", AlarmClass.LUMP, 8, now().wall_s, now.monotonic_s)
    assert keep == KeepEvidence(trigger)
    assert isinstance(write, Write)
    (entry,) = write.entries
    assert publish == Publish(entry)
    assert json.loads(entry.record)["data"]["evidence"] == entry.event.details["evidence"] == name
    assert count == Count("apron", AlarmClass.LUMP, change.transition, 0.987654, 42)
    assert confirm == Confirm((("apron", name),))


def test_evidence_begins_before_the_record_that_names_it_is_written() -> None:
    world, evidence = World(), AllEvidence()
    announcer(world, evidence=evidence).announce((RESULT,))
    (trigger,) = evidence.begun
    assert [one["data"]["evidence"] for one in world.of("alarm")] == [trigger.id]


def test_a_change_that_cannot_be_recorded_is_said_before_it_is_made() -> None:
    world = World()
    target = announcer(world)
    (change,) = RESULT.changes
    made = replace(change.transition, actor="\ud800")
    with pytest.raises(RecordError, match=r"^cam/apron: lump alarm raised"):
        target.check(STILL, AlarmClass.LUMP, (change.alarm, (made,)))
    assert world.seen == []
    assert target.sequence("apron") == 0


def test_shelving_again_and_again_makes_one_evidence_of_one_lump() -> None:
    evidence = AllEvidence()
    target = announcer(World(), evidence=evidence)
    (raised,) = RESULT.changes
    target.announce((RESULT,))
    flood = [
        replace(raised, transition=replace(raised.transition, change=change))
        for change in (Change.SHELVED, Change.UNSHELVED, Change.RAISED)
    ]
    for _ in range(20):
        target.announce((replace(RESULT, changes=tuple(flood)),))
    assert len(evidence.begun) == 1
    over = replace(raised, transition=replace(raised.transition, change=Change.CLEARED))
    target.announce((replace(RESULT, changes=(over,)),))
    target.announce((RESULT,))
    assert len(evidence.begun) == 2
