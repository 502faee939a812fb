"""The main loop of a monitor with everything that it stands on by hand: no process, no network, no waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    AlarmRequestError,
    Changed,
    Frame,
    Rules,
    Trouble,
    all_of,
    suppress,
)
from lumpwatch.service.monitor.alarm_record import RecordError
from lumpwatch.service.protocol import COMMANDS
from lumpwatch.service.storage import PriorStore, event_file, read_events
from lumpwatch.service.telemetry import RESTARTS_WITHIN_S
from tests.monitor.fakes import World
from tests.service_helpers import frame, prior

REGION = "lumpwatch/v1/pit/cam/apron"
HALF_A_PAIR = "\ud800"


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    PriorStore(tmp_path).save(prior())
    made = World(tmp_path)
    yield made
    made.events.close()


def show(world: World, seconds: float, *, bright: bool, late_s: float = 0.0) -> list[Callable[[], Frame]]:
    """Ten frames a second, each decided `late_s` after its capture."""

    def step(k: int) -> Callable[[], Frame]:
        def take() -> Frame:
            world.clock.now_s += 0.1
            at = world.clock.now_s - late_s
            return frame(round(at * 10), bright=bright, time_s=at, received_s=at)

        return take

    return [step(k) for k in range(round(seconds * 10))]


def wait(world: World, seconds: float) -> list[Callable[[], None]]:
    """No frames."""

    def take() -> None:
        world.clock.now_s += 0.25

    return [take] * round(seconds * 4)


def then(action: Callable[[], object]) -> Callable[[], None]:
    """Something that happens between two frames."""

    def take() -> None:
        action()

    return take


def ack(world: World, name: str = "Ada") -> Callable[[], None]:
    return then(lambda: world.bus.ask(f"{REGION}/ack", actor=name))


def changes(world: World, of: str = "lump") -> list[str]:
    return [one["data"]["change"] for one in world.bus.of("alarm") if one["data"]["class"] == of]


def logged(world: World, store: Path) -> list[tuple[int, str, str | None]]:
    world.events.close()
    return [(one.sequence, one.change, one.actor) for one in read_events(event_file(store, "cam"))]


def test_a_lump_is_announced_acknowledged_and_over(world: World, tmp_path: Path) -> None:
    world.run(
        *show(world, 1.0, bright=False),
        *show(world, 1.0, bright=True),
        ack(world),
        *show(world, 2.0, bright=False),
    )
    assert changes(world) == ["raised", "acknowledged", "cleared"]
    states = [one["state"] for one in world.bus.of("state")]
    assert [states[0], *dict.fromkeys(states)] == ["BLIND", "BLIND", "CLEAR", "LUMP"]
    assert world.daemon.state == "running"
    assert set(world.daemon.decided) == {"apron"}
    raised = next(one["data"] for one in world.bus.of("alarm") if one["data"]["change"] == "raised")
    assert [one.id for one in world.evidence.triggers if one.alarm_class is AlarmClass.LUMP] == [
        raised["evidence"]
    ]
    told = [(sequence, change) for sequence, change, _ in logged(world, tmp_path)]
    assert told == [(one["data"]["sequence"], one["data"]["change"]) for one in world.bus.of("alarm")]


def test_without_frames_it_is_blind_and_says_so(world: World) -> None:
    world.run(*show(world, 1.0, bright=False), *wait(world, 30.0))
    assert world.bus.of("state")[-1]["reason"] == "no_stream"
    assert "raised" in changes(world, "blind")
    assert world.bus.of("heartbeat")[-1]["rois"]["apron"]["state"] == "BLIND"


def test_it_beats_once_a_second(world: World) -> None:
    world.run(*show(world, 10.0, bright=False))
    assert 9 <= len(world.bus.of("heartbeat")) <= 11
    assert world.proofs.looked == len(world.bus.of("heartbeat"))
    assert world.daemon.beats == 101
    assert all(one["valid"] for one in world.bus.of("heartbeat")[1:])


def test_it_is_alive_and_each_region_is_one_queryable(world: World) -> None:
    world.run()
    assert world.bus.tokens == ["lumpwatch/v1/pit/@alive/monitor/cam"]
    assert world.bus.queryables == [REGION]
    assert {key.rpartition("/")[2] for key in world.bus.services} == set(COMMANDS)
    assert list(world.bus.subscriptions) == [
        "lumpwatch/v1/pit/cam/*/suppress",
        "lumpwatch/v1/pit/cam/*/feed",
    ]


def test_a_put_suppresses_and_its_end_announces(world: World) -> None:
    def put(payload: bytes) -> Callable[[], None]:
        callback = world.bus.subscriptions["lumpwatch/v1/pit/cam/*/suppress"]
        return lambda: callback(f"{REGION}/suppress", payload)

    world.run()
    world.run(
        then(put(b'{"signal": "feeder", "valid_s": 2}')),
        *show(world, 4.0, bright=True),
        then(put(b"nonsense")),
    )
    assert changes(world)[:4] == ["suppressed", "active", "unsuppressed", "raised"]
    assert world.metric("commands_refused_total", command="suppress") == 1


def test_the_plant_tells_of_the_feed_and_that_runs_out(world: World) -> None:
    def tell() -> None:
        reply = world.bus.ask(f"{REGION}/feed", signal="drive", valid_s="2", runs="true", speed_mm_s="600")
        assert reply == {"taken": True}

    world.run(*show(world, 1.0, bright=False), then(tell), *show(world, 4.0, bright=False))
    told = [one["feed"] for one in world.bus.of("state")]
    assert (told[0]["plant_runs"], told[-1]["plant_runs"]) == (None, None)
    assert {one["plant_speed_mm_s"] for one in told} == {None, 600.0}


@pytest.mark.parametrize(
    "payload", [rb'{"actor": "\ud800"}', b'{"actor": "\xed\xa0\x80"}', b'{"actor": "' + 129 * b"x" + b'"}']
)
def test_an_acknowledgement_that_cannot_be_recorded_is_refused_at_the_door(
    world: World, tmp_path: Path, payload: bytes
) -> None:
    def refused() -> None:
        with pytest.raises(AlarmRequestError):
            world.bus.ask_json(f"{REGION}/ack", payload)

    world.run(*show(world, 2.0, bright=True), then(refused), *show(world, 0.5, bright=True))
    assert world.bus.of("state")[-1]["alarm"] == "UNACKNOWLEDGED"
    assert world.metric("commands_refused_total", command="ack") == 1
    assert [change for _, change, _ in logged(world, tmp_path)].count("acknowledged") == 0


def test_what_cannot_be_recorded_does_not_happen(world: World, tmp_path: Path) -> None:
    """The alarm was once suppressed unrecorded, and the end of the suppression ended the process."""

    def unrecordable() -> None:
        def action(alarm: Alarm, rules: Rules, now_s: float) -> Changed:
            return all_of(suppress(alarm, rules, now_s, HALF_A_PAIR, 1.0))

        with pytest.raises(RecordError):
            world.monitor.apply("apron", AlarmClass.LUMP, action)

    world.run(*show(world, 1.0, bright=False), then(unrecordable), *show(world, 4.0, bright=True), ack(world))
    assert changes(world) == ["raised", "acknowledged"]
    assert next(one for one in logged(world, tmp_path) if one[1] == "acknowledged")[2] == "Ada"
    assert world.metric("event_log_problems_total") == 0


def test_a_re_alarm_waits_as_long_as_people_do(tmp_path: Path) -> None:
    """Pictures come 0.8 s late; the alarm was once taken to be announced when the picture was captured."""
    PriorStore(tmp_path).save(prior())
    world = World(tmp_path, re_alarm_s=5.0)
    world.run(*show(world, 8.0, bright=True, late_s=0.8))
    assert changes(world) == ["raised", "re_alarmed"]
    world.events.close()
    raised, again = (
        one.monotonic_s
        for one in read_events(event_file(tmp_path, "cam"))
        if one.alarm_class is AlarmClass.LUMP
    )
    assert again - raised == pytest.approx(5.0, abs=0.05)


def test_a_new_prior_is_taken_while_running(world: World, tmp_path: Path) -> None:
    taken = threading.Event()

    def store() -> None:
        PriorStore(tmp_path).save(prior())

    def look() -> Frame | None:
        world.clock.now_s += 0.1
        if world.evidence.restarts:
            taken.set()
        return frame(round(world.clock.now_s * 10), time_s=world.clock.now_s, received_s=world.clock.now_s)

    def until_taken() -> Frame | None:
        if not taken.is_set():
            world.bus.inbox.script.append(until_taken)
            taken.wait(0.02)
        return look()

    world.run(*show(world, 0.5, bright=False), then(store), until_taken)
    assert world.bus.of("state")[-1]["prior"] == 2
    assert world.evidence.restarts == 1


class HungStore(PriorStore):
    """A store whose disk hangs from the first shadow that is asked for after `hangs` was set."""

    hangs = threading.Event()
    released = threading.Event()
    asked = threading.Event()

    def pointer(self, camera: str, roi: str) -> int | None:
        if self.hangs.is_set():
            self.asked.set()
            self.released.wait(60)
        return super().pointer(camera, roi)


def test_a_disk_that_hangs_holds_up_no_decision(tmp_path: Path) -> None:
    """The store was once read under the alarm's lock."""
    PriorStore(tmp_path).save(prior())
    world = World(tmp_path, HungStore(tmp_path))
    try:

        def hang() -> None:
            HungStore.hangs.set()
            assert HungStore.asked.wait(10)

        world.run(then(hang), *show(world, 2.0, bright=True), ack(world))
        assert changes(world) == ["raised", "acknowledged"]
    finally:
        HungStore.released.set()
        HungStore.hangs.clear()
        world.events.close()


def test_what_a_proof_test_found_is_the_system_alarm(world: World) -> None:
    world.proofs.found = {Trouble.PROOF_TEST: True}
    world.run(*show(world, 10.0, bright=False))
    (raised,) = [one["data"] for one in world.bus.of("alarm") if one["data"]["class"] == "system"]
    assert (raised["change"], raised["reason"]) == ("raised", "proof_test")


@pytest.mark.parametrize(("restarts", "reasons"), [(2, []), (3, ["restarts"])])
def test_a_monitor_that_ends_again_and_again_is_the_system_alarm(
    world: World, restarts: int, reasons: list[str]
) -> None:
    """Each of them is blind while it starts, and none for as long as the alarm of class `blind` waits."""

    def calm() -> None:
        world.clock.now_s += RESTARTS_WITHIN_S

    world.daemon.restarts = restarts
    world.run(*show(world, 8.0, bright=False), then(calm), *show(world, 10.0, bright=False))
    changes = [one["data"] for one in world.bus.of("alarm") if one["data"]["class"] == "system"]
    assert [one["reason"] for one in changes if one["change"] == "raised"] == reasons
    assert [one["change"] for one in changes] == ["raised", "cleared"][: 2 * len(reasons)]


def test_a_second_camera_or_monitor_of_the_same_name_is_the_system_alarm(world: World) -> None:
    def rival() -> None:
        world.bus.inbox.foreign += 20
        world.bus.others["lumpwatch/v1/pit/cam/heartbeat"]("b" * 16)

    world.run(*show(world, 2.0, bright=False), then(rival), *show(world, 5.0, bright=False))
    raised = [one["data"] for one in world.bus.of("alarm") if one["data"]["class"] == "system"]
    assert raised[0]["reason"] == "second_monitor, second_source"


def test_commands_that_are_not_about_an_alarm(world: World) -> None:
    answers: dict[str, Any] = {}

    def ask() -> None:
        answers["proof"] = world.bus.ask(f"{REGION}/proof", actor="Ada")
        answers["evidence"] = world.bus.ask(f"{REGION}/evidence")
        answers["verdict"] = world.bus.ask(f"{REGION}/verdict", actor="Ada", verdict="true")
        answers["prior"] = world.bus.services[f"{REGION}/prior"].handler({}, None)

    world.run(*show(world, 2.0, bright=True), then(ask))
    assert (answers["proof"]["outcome"], answers["proof"]["actor"]) == ("passed", "Ada")
    assert answers["evidence"] == ["apron"]
    raised = next(one for one in world.bus.of("alarm") if one["data"]["class"] == "lump")
    assert answers["verdict"] == {
        "verdict": "true",
        "sequence": raised["data"]["sequence"],
        "alarm": raised["id"],
        "written": True,
    }
    assert len(answers["prior"]) > 1000
