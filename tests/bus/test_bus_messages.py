"""States, alarms, queries and liveliness between real sessions."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.endpoints import Reply, from_wire, to_wire
from lumpwatch.service.bus.errors import BusError
from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.ordering import Message
from lumpwatch.service.bus.services import Service
from lumpwatch.service.bus.session import open_client, open_hub
from tests.bus.test_bus_support import Child, client_config, eventually, free_endpoint, hub_config, repeat
from tests.bus.tokens import Tokens

KEYS = Keys("north")
STATE, ALARM, ACK = KEYS.state("c", "r"), KEYS.alarm("c", "r"), KEYS.command("c", "r", "ack")


@pytest.fixture
def hub() -> Iterator[Bus]:
    with open_hub(hub_config(free_endpoint())) as bus:
        yield bus


@pytest.fixture
def one(hub: Bus) -> Iterator[Bus]:
    with open_client(client_config(hub.endpoints[0]), wait=False) as bus:
        yield bus


@pytest.fixture
def two(hub: Bus) -> Iterator[Bus]:
    with open_client(client_config(hub.endpoints[0]), wait=False) as bus:
        yield bus


class Log:
    """Remembers what it is called with."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, bytes]] = []

    def __call__(self, key: str, payload: bytes) -> None:
        self.calls.append((key, payload))

    @property
    def payloads(self) -> list[bytes]:
        return [payload for _, payload in self.calls]


def test_messages_reach_a_subscriber_with_key_and_payload(one: Bus, two: Bus) -> None:
    log = Log()
    two.subscribe(KEYS.states(), log)
    publisher = one.publisher(STATE)
    repeat(lambda: publisher.put(b"{}"), lambda: log.calls)
    assert log.calls[0] == (STATE, b"{}")


def test_the_last_state_is_there_for_those_who_ask_and_for_those_who_join(one: Bus, two: Bus) -> None:
    publisher = one.publisher(STATE)
    eventually(lambda: two.ask(KEYS.states()) == [])
    publisher.put(b"old")
    publisher.put(b"new")
    eventually(lambda: two.ask(STATE) == [Reply(STATE, b"new")])
    assert two.ask(KEYS.states()) == [Reply(STATE, b"new")]
    log = Log()
    two.subscribe(KEYS.states(), log, history=True)
    eventually(lambda: log.payloads == [b"new"])
    publisher.put(b"newer")
    eventually(lambda: log.payloads == [b"new", b"newer"])


def test_the_last_state_of_a_publisher_that_comes_later(one: Bus, two: Bus) -> None:
    log = Log()
    two.subscribe(KEYS.states(), log, history=True)
    one.publisher(STATE).put(b"1")
    eventually(lambda: log.payloads == [b"1"])


def test_a_late_alarm_subscriber_gets_history_and_then_what_follows(one: Bus, two: Bus) -> None:
    publisher = one.alarm_publisher(ALARM)
    for n in range(70):
        publisher.put(b"%d" % n)
    log = Log()
    time.sleep(0.3)
    two.subscribe_alarms(KEYS.alarms(), log)
    eventually(lambda: len(log.calls) == 64)
    publisher.put(b"70")
    eventually(lambda: len(log.calls) == 65)
    assert log.calls == [(ALARM, b"%d" % n) for n in range(6, 71)]


@pytest.mark.parametrize("join_at", range(3, 11))
def test_a_subscriber_that_comes_in_the_midst_of_a_burst_gets_all_of_it(
    one: Bus, two: Bus, join_at: int
) -> None:
    log = Log()
    publisher = one.alarm_publisher(ALARM)
    for n in range(40):
        publisher.put(b"%d" % n)
        if n == join_at:
            two.subscribe_alarms(KEYS.alarms(), log)
        time.sleep(0.001)
    eventually(lambda: len(log.calls) == 40)
    assert log.payloads == [b"%d" % n for n in range(40)]


def test_alarms_outlive_their_publisher_and_nobody_gets_them_twice(one: Bus, two: Bus) -> None:
    """A new publisher that keeps what its predecessor sent: late joiners see it, others do not again."""
    first = one.alarm_publisher(ALARM)
    there, plain = Log(), Log()
    two.subscribe_alarms(KEYS.alarms(), there)
    two.subscribe(KEYS.alarms(), plain)
    # A plain subscriber fetches nothing afterwards. Declared in order: what hears this later one knows that one too.
    declared, states = Log(), one.publisher(STATE)
    two.subscribe(KEYS.states(), declared)
    repeat(lambda: states.put(b"{}"), lambda: declared.calls)
    for number in (5, 6, 7):
        first.put(b"%d" % number, number)
    eventually(lambda: there.payloads == plain.payloads == [b"5", b"6", b"7"])
    first.close()
    kept = [Message(ALARM, b"%d" % number, first.name, number) for number in (5, 6, 7, 8)]
    again = one.alarm_publisher(ALARM, kept)  # it knows of one that was never sent
    eventually(lambda: there.payloads == [b"5", b"6", b"7", b"8"])
    late = Log()
    two.subscribe_alarms(KEYS.alarms(), late)
    eventually(lambda: late.payloads == [b"5", b"6", b"7", b"8"])
    again.put(b"8", 8, first.name)  # sent again, as after a crash
    again.put(b"9", 9)
    eventually(lambda: plain.payloads[-1] == late.payloads[-1] == there.payloads[-1] == b"9")
    assert there.payloads == late.payloads == [b"5", b"6", b"7", b"8", b"9"]
    assert plain.payloads == [b"5", b"6", b"7", b"8", b"9"]
    # A subscriber in the publisher's own session hears of it too.
    near = Log()
    one.subscribe_alarms(KEYS.alarms(), near)
    eventually(lambda: near.payloads == late.payloads)


def test_kept_alarms_can_be_asked_for(one: Bus, two: Bus) -> None:
    publisher = one.alarm_publisher(ALARM)
    publisher.put(b"1")
    publisher.put(b"2")
    eventually(lambda: two.ask(KEYS.alarms()) == [Reply(ALARM, b"1"), Reply(ALARM, b"2")])


def test_a_plain_subscriber_hears_alarms_too(one: Bus, two: Bus) -> None:
    log = Log()
    two.subscribe(KEYS.alarms(), log)
    publisher = one.alarm_publisher(ALARM)
    repeat(lambda: publisher.put(b"{}"), lambda: log.calls)
    assert log.calls[0] == (ALARM, b"{}")


def test_a_callback_that_raises_is_logged_and_called_again(
    one: Bus, two: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    log = Log()

    def fail_on_odd(key: str, payload: bytes) -> None:
        log(key, payload)
        if int(payload) % 2:
            raise ValueError("odd")

    two.subscribe_alarms(KEYS.alarms(), fail_on_odd)
    publisher = one.alarm_publisher(ALARM)
    for n in range(4):
        publisher.put(b"%d" % n)
    eventually(lambda: log.payloads == [b"0", b"1", b"2", b"3"])
    eventually(lambda: caplog.text.count("ValueError: odd") == 2)


def test_a_closed_subscription_is_silent_and_another_goes_on(one: Bus, two: Bus) -> None:
    closed, kept = Log(), Log()
    subscription = two.subscribe(STATE, closed)
    two.subscribe(STATE, kept)
    publisher = one.publisher(STATE)
    repeat(lambda: publisher.put(b"1"), lambda: closed.calls and kept.calls)
    subscription.close()
    subscription.close()
    repeat(lambda: publisher.put(b"2"), lambda: b"2" in kept.payloads)
    assert b"2" not in closed.payloads


def test_a_query_and_its_answer(one: Bus, two: Bus) -> None:
    seen: list[tuple[dict[str, str], bytes | None]] = []

    def acknowledge(parameters: dict[str, str], payload: bytes | None) -> bytes:
        seen.append((parameters, payload))
        return b"done"

    two.serve(ACK, acknowledge)
    eventually(lambda: one.ask(ACK) == [Reply(ACK, b"done")])
    assert one.ask(ACK, {"by": "Zoë; a=b", "note": ""}, b"") == [Reply(ACK, b"done")]
    assert one.ask(KEYS.command("c", "r", "ack"), payload=b"\x00\xff") == [Reply(ACK, b"done")]
    assert seen[-3:] == [({}, None), ({"by": "Zoë; a=b", "note": ""}, b""), ({}, b"\x00\xff")]


def test_the_error_of_a_handler_comes_back_as_one_line(
    one: Bus, two: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(parameters: dict[str, str], payload: bytes | None) -> bytes:
        if "bug" in parameters:
            raise KeyError("two\nlines")
        raise BusError("no such alarm")

    two.serve(ACK, refuse)
    eventually(lambda: one.ask(ACK) == [Reply(ACK, error="no such alarm")])
    assert caplog.text == ""
    assert one.ask(ACK, {"bug": "1"}) == [Reply(ACK, error="KeyError: 'two\\nlines'")]
    assert "the query failed" in caplog.text


def test_asking_nobody_and_asking_one_who_does_not_answer(one: Bus, two: Bus) -> None:
    assert one.ask(ACK, timeout_s=0.5) == []
    release = threading.Event()

    def hang(parameters: dict[str, str], payload: bytes | None) -> bytes:
        release.wait(30)
        return b""

    two.serve(ACK, hang)
    try:
        eventually(lambda: one.ask(ACK, timeout_s=0.2) == [Reply(ACK, error="Timeout")])
    finally:
        release.set()


REGION = KEYS.region("c", "r")


def test_several_services_are_one_queryable_and_told_apart_by_the_last_part(one: Bus, two: Bus) -> None:
    def named(name: str) -> Service:
        return Service(lambda parameters, payload: f"{name} {parameters} {payload!r}".encode(), "lane")

    two.publisher(STATE).put(b"state")
    before = threading.active_count()
    two.serve_all(REGION, {"ack": named("ack"), "reset": named("reset")})
    assert threading.active_count() == before + 1
    eventually(lambda: one.ask(ACK) == [Reply(ACK, b"ack {} None")])
    assert one.ask(f"{REGION}/reset", {"by": "Ada"}, b"!") == [
        Reply(f"{REGION}/reset", b"reset {'by': 'Ada'} b'!'")
    ]
    everywhere = KEYS.commands("reset")
    assert one.ask(everywhere) == [Reply(f"{REGION}/reset", b"reset {} None")]
    assert one.ask(f"{REGION}/unknown") == []
    assert one.ask(STATE) == [Reply(STATE, b"state")]  # that of the publisher alone
    # A wildcard must not be taken for every command at once.
    assert [reply.key for reply in one.ask(f"{REGION}/*")] == [STATE]
    assert [reply.key for reply in one.ask(f"{REGION}/**")] == [STATE]


def test_a_lane_that_is_busy_holds_up_no_other_and_may_refuse(one: Bus, two: Bus) -> None:
    began, release = threading.Event(), threading.Event()

    def last(parameters: dict[str, str], payload: bytes | None) -> bytes:
        began.set()
        release.wait(30)
        return b"done"

    proof = f"{REGION}/proof"
    two.serve_all(
        REGION, {"ack": Service(lambda *_: b"ok", "short"), "proof": Service(last, "long", waits=False)}
    )
    eventually(lambda: one.ask(ACK) == [Reply(ACK, b"ok")])
    first: list[Reply] = []
    asking = threading.Thread(target=lambda: first.extend(one.ask(proof, timeout_s=30)))
    asking.start()
    try:
        assert began.wait(10)
        (refused,) = one.ask(proof)
        assert refused.payload is None
        assert "under way" in (refused.error or "")
        assert one.ask(ACK) == [Reply(ACK, b"ok")]
    finally:
        release.set()
        asking.join(10)
    assert first == [Reply(proof, b"done")]
    began.clear()
    assert one.ask(proof) == [Reply(proof, b"done")]


def test_parameters_that_are_not_utf8_are_refused(
    one: Bus, two: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    asked: list[dict[str, str]] = []

    def take(parameters: dict[str, str], _: bytes | None) -> bytes:
        asked.append(parameters)
        return b"done"

    two.serve(ACK, take)
    eventually(lambda: one.ask(ACK) == [Reply(ACK, b"done")])
    before = len(asked)
    for bad in ("%FF", "%ED%A0%80"):
        (reply,) = one.ask(f"{ACK}?actor={bad}")
        assert "UTF-8" in (reply.error or "")
    assert asked[before:] == []
    assert caplog.text == ""


def test_liveliness_of_a_token_and_of_its_process(hub: Bus, two: Bus) -> None:
    key, before = KEYS.alive("camera", "c"), KEYS.alive("monitor", "m")
    two.alive(before)
    with Tokens(hub.endpoints[0], "lumpwatch/v1/north/@alive/**") as tokens:
        eventually(lambda: tokens.events == [(before, True)])
        with open_client(client_config(hub.endpoints[0]), wait=False) as client:
            token = client.alive(key)
            eventually(lambda: tokens.events[1:] == [(key, True)])
            eventually(lambda: tokens.present() == [key, before])
            token.close()
            eventually(lambda: tokens.events[2:] == [(key, False)])
            client.alive(key)
            eventually(lambda: tokens.events[3:] == [(key, True)])
        eventually(lambda: tokens.events[4:] == [(key, False)])
        eventually(lambda: tokens.present() == [before])


def test_parameters_on_the_wire() -> None:
    assert to_wire({"by": "a b;c=d", "x": ""}) == "by=a%20b%3Bc%3Dd;x="
    assert from_wire("by=a%20b%3Bc%3Dd;x=") == {"by": "a b;c=d", "x": ""}
    assert from_wire("flag;;a=b=c") == {"flag": "", "a": "b=c"}
    assert from_wire("") == {}


@contextmanager
def hub_and_two(endpoint: str) -> Iterator[tuple[Child, Bus, Bus]]:
    with (
        Child("hub", endpoint) as hub,
        open_client(client_config(endpoint), wait=False) as one,
        open_client(client_config(endpoint), wait=False) as two,
    ):
        yield hub, one, two


@pytest.mark.slow
@pytest.mark.parametrize("down_s", [0.5, 4.0])
def test_every_alarm_arrives_once_and_in_order_over_a_restart_of_the_hub(down_s: float) -> None:
    endpoint = free_endpoint()
    log = Log()
    missed: list[int] = []
    sent = 0

    with hub_and_two(endpoint) as (first_hub, one, two):
        publisher = one.alarm_publisher(ALARM)
        two.subscribe_alarms(KEYS.alarms(), log, missed.append)

        def send_for(duration_s: float) -> None:
            nonlocal sent
            end = time.monotonic() + duration_s
            while time.monotonic() < end:
                publisher.put(b"%d" % sent)
                sent += 1
                time.sleep(0.1)

        send_for(1)
        first_hub.process.kill()
        first_hub.process.wait()
        send_for(down_s)
        with Child("hub", endpoint):
            send_for(1)
            eventually(lambda: len(log.calls) >= sent)
            time.sleep(1)
    assert log.payloads == [b"%d" % n for n in range(sent)]
    assert missed == []


@pytest.mark.slow
def test_alarms_that_cannot_be_fetched_again_are_told() -> None:
    endpoint = free_endpoint()
    log = Log()
    missed: list[int] = []
    with hub_and_two(endpoint) as (first_hub, one, two):
        publisher = one.alarm_publisher(ALARM)
        two.subscribe_alarms(KEYS.alarms(), log, missed.append)
        publisher.put(b"0")
        eventually(lambda: log.payloads == [b"0"])
        first_hub.process.kill()
        first_hub.process.wait()
        time.sleep(0.5)
        for n in range(1, 101):
            publisher.put(b"%d" % n)
        with Child("hub", endpoint):
            eventually(lambda: log.payloads[-1:] == [b"100"])
            eventually(lambda: sum(missed) == 36)
    assert log.payloads == [b"0", *(b"%d" % n for n in range(37, 101))]
