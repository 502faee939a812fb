"""Frames between sessions and between processes: newest wins, nothing queues, junk is counted."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import zenoh

from lumpwatch.service.bus import codec
from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.errors import BusClosed, Malformation
from lumpwatch.service.bus.frames import FrameInbox
from lumpwatch.service.bus.session import open_client, open_hub
from tests.bus.test_bus_support import (
    Child,
    client_config,
    eventually,
    free_endpoint,
    gray,
    hub_config,
    repeat,
)

KEY, JPEG_KEY = "site/c/frame", "site/c/frame/jpeg"


@pytest.fixture
def hub() -> Iterator[Bus]:
    with open_hub(hub_config(free_endpoint())) as bus:
        yield bus


@pytest.fixture
def client(hub: Bus) -> Iterator[Bus]:
    with open_client(client_config(hub.endpoints[0]), wait=False) as bus:
        yield bus


def taken(inbox: FrameInbox) -> list[int]:
    frame = inbox.take(0.05)
    return [] if frame is None else [frame.seq]


@pytest.mark.parametrize("memory", ["shm", "tcp"])
def test_frames_between_two_processes(memory: str) -> None:
    endpoint = free_endpoint()
    with (
        open_hub(hub_config(endpoint, shared_memory=memory == "shm")),
        Child("monitor", endpoint, KEY, memory, "0") as monitor,
        Child("camera", endpoint, KEY, memory, "640", "480", "50") as camera,
    ):
        time.sleep(1)
        assert camera.finish()["sent"] > 10
        report = monitor.finish()
    assert report["taken"] > 5
    assert report["ordered"]
    assert report["wrong"] == 0
    assert report["other_clock"] == 0
    # The first few may still go over TCP while the shared memory is being set up.
    assert (report["shared"] > 0) == (memory == "shm")


@pytest.mark.slow
@pytest.mark.parametrize("memory", ["shm", "tcp"])
def test_a_slow_consumer_skips_and_does_not_grow(memory: str) -> None:
    endpoint = free_endpoint()
    with (
        open_hub(hub_config(endpoint, shared_memory=memory == "shm")) as hub,
        Child("monitor", endpoint, KEY, memory, "0.5") as monitor,
    ):
        publisher = hub.frame_publisher(KEY)
        for seq in range(100):
            publisher.publish(gray(seq, 1920, 1080))
            time.sleep(0.01)
        time.sleep(1.5)
        report = monitor.finish()
    # 200 MB were sent: at most a few frames may be in memory at once.
    assert report["grown_kb"] < 60_000
    assert report["ordered"]
    assert report["last"] == 99
    # Under load the publisher itself may drop a frame; the rest are either taken or counted.
    assert 1 < report["taken"] < 20
    assert 50 < report["taken"] + report["skipped"] <= 100


def test_newest_wins_and_skipped_are_counted(hub: Bus, client: Bus) -> None:
    inbox = client.frame_inbox(KEY)
    publisher = hub.frame_publisher(KEY)
    repeat(lambda: publisher.publish(gray(0)), lambda: taken(inbox))
    before = inbox.skipped
    for seq in range(1, 11):
        publisher.publish(gray(seq))
    eventually(lambda: inbox.skipped == before + 9)
    assert taken(inbox) == [10]
    assert inbox.skipped == before + 9
    assert taken(inbox) == []


def test_take_waits_no_longer_than_told(hub: Bus) -> None:
    inbox = hub.frame_inbox(KEY)
    started = time.monotonic()
    assert inbox.take(0.1) is None
    assert time.monotonic() - started >= 0.1
    assert inbox.take(0.0) is None


def test_closing_wakes_who_waits(hub: Bus) -> None:
    inbox = hub.frame_inbox(KEY)
    raised = threading.Event()

    def wait() -> None:
        try:
            inbox.take(60)
        except BusClosed:
            raised.set()

    waiting = threading.Thread(target=wait)
    waiting.start()
    hub.close()
    waiting.join(30)
    assert raised.is_set()
    with pytest.raises(BusClosed):
        inbox.take(0)


def test_jpeg_on_the_wire(hub: Bus, client: Bus) -> None:
    inbox = client.frame_inbox(KEY)
    publisher = hub.frame_publisher(KEY)
    frame = replace(gray(100), width=100, height=90, crop=(10, 20, 64, 48))
    got = []

    def take() -> bool:
        got.append(inbox.take(0.05))
        return got[-1] is not None

    repeat(lambda: publisher.publish(frame, "jpeg"), take)
    assert got[-1] is not None
    assert got[-1].crop == frame.crop
    assert np.abs(got[-1].data.astype(int) - 100).max() <= 2


def test_the_picture_is_made_only_for_listeners(hub: Bus, client: Bus) -> None:
    publisher = hub.frame_publisher(KEY, JPEG_KEY)
    assert not publisher.picture_wanted
    publisher.publish(gray(0), "raw", picture=gray(50, 128, 96))
    viewer = client.frame_inbox(JPEG_KEY)
    eventually(lambda: publisher.picture_wanted)
    publisher.publish(gray(1), "raw", picture=gray(51, 128, 96))
    frame = viewer.take(30)
    assert frame is not None
    assert (frame.seq, frame.data.shape) == (51, (96, 128))
    publisher.publish(gray(2))
    frame = viewer.take(30)
    assert frame is not None
    assert (frame.seq, frame.data.shape) == (2, (48, 64))
    viewer.close()
    eventually(lambda: not publisher.picture_wanted)


def test_a_publisher_without_a_jpeg_key_makes_no_picture(hub: Bus) -> None:
    assert not hub.frame_publisher(KEY).picture_wanted


def test_malformed_messages_are_counted_and_the_next_good_frame_arrives(hub: Bus, client: Bus) -> None:
    inbox = client.frame_inbox(KEY)
    payload, header = codec.encode_frame(gray(1), "elsewhere")
    stranger = zenoh.Config()
    for name, value in {"mode": "client", "connect/endpoints": list(hub.endpoints)}.items():
        stranger.insert_json5(name, json.dumps(value))
    junk: list[tuple[bytes, bytes | None, Malformation]] = [
        (b"junk", None, Malformation.NO_HEADER),
        (b"junk", b"junk", Malformation.BAD_HEADER),
        (b"", header, Malformation.BAD_LENGTH),
        (payload[:-1], header, Malformation.BAD_LENGTH),
        (payload, header + b" " * 4096, Malformation.HEADER_TOO_LONG),
        (payload, header.replace(b'"v":1', b'"v":9'), Malformation.UNKNOWN_VERSION),
        (payload, header.replace(b'"encoding":"gray8"', b'"encoding":"jpeg"'), Malformation.BAD_JPEG),
    ]
    with zenoh.open(stranger) as session:
        repeat(lambda: session.put(KEY, payload, attachment=header), lambda: taken(inbox))
        for data, attachment, reason in junk:
            before = inbox.malformed[reason]
            session.put(KEY, data, attachment=attachment)

            def counted(reason: Malformation = reason, before: int = before) -> bool:
                return taken(inbox) == [] and inbox.malformed[reason] > before

            eventually(counted)
        session.delete(KEY)
        eventually(lambda: taken(inbox) == [] and inbox.malformed[Malformation.NO_HEADER] == 2)
        session.put(KEY, payload, attachment=header)
        frame = inbox.take(30)
    assert frame is not None
    assert frame.seq == 1
    assert inbox.same_clock is False
    assert inbox.malformed.total() == len(junk) + 1


def test_frames_flow_again_after_an_inbox_is_closed(hub: Bus, client: Bus) -> None:
    publisher = hub.frame_publisher(KEY)
    first, second = client.frame_inbox(KEY), client.frame_inbox(KEY)
    repeat(lambda: publisher.publish(gray(0)), lambda: taken(first))
    first.close()
    first.close()
    repeat(lambda: publisher.publish(gray(1)), lambda: 1 in taken(second))


@pytest.mark.slow
@pytest.mark.parametrize("memory", ["shm", "tcp"])
def test_a_stalled_subscriber_stalls_nobody_else(memory: str) -> None:
    endpoint = free_endpoint()
    with (
        open_hub(hub_config(endpoint, shared_memory=memory == "shm")),
        Child("monitor", endpoint, KEY, memory, "0") as stalled,
        Child("monitor", endpoint, KEY, memory, "0") as healthy,
        Child("camera", endpoint, KEY, memory, "1920", "1080", "15") as camera,
    ):
        time.sleep(1)
        stalled.process.send_signal(signal.SIGSTOP)
        time.sleep(8)
        sent = camera.finish()
        report = healthy.finish()
        stalled.process.send_signal(signal.SIGCONT)
    assert sent["longest_s"] < 2
    assert sent["sent"] > 60
    assert report["taken"] > 0.5 * sent["sent"]
    assert report["last"] > sent["sent"] - 20
    assert report["median_age_s"] < 0.5


@pytest.mark.slow
def test_close_is_bounded_where_the_hub_is_frozen_under_load() -> None:
    endpoint = free_endpoint()
    with Child("hub", endpoint) as hub, Child("monitor", endpoint, KEY, "tcp", "0"):
        client = open_client(client_config(endpoint, shared_memory=False))
        publisher = client.frame_publisher(KEY)
        alarms = client.alarm_publisher("site/c/r/alarm")
        client.subscribe_alarms("site/*/*/alarm", lambda _key, _payload: None)
        client.serve("site/c/r/ack", lambda _parameters, _payload: b"")
        time.sleep(0.5)
        hub.process.send_signal(signal.SIGSTOP)
        for seq in range(20):
            publisher.publish(gray(seq, 1920, 1080))
        alarms.put(b"{}")
        started = time.monotonic()
        client.close()
        took_s = time.monotonic() - started
    assert took_s < 4
