"""Readers that have stopped reading: they hold up neither who decides nor other readers, and are counted."""

from __future__ import annotations

import contextlib
import signal
import threading
import time

import numpy as np
import pytest

from lumpwatch.service.bus.callback_queue import Worker
from lumpwatch.service.bus.connections import tcp_ports
from lumpwatch.service.bus.cut_off import Burden, CutOff
from lumpwatch.service.bus.endpoints import Publisher
from lumpwatch.service.bus.errors import BusClosed
from lumpwatch.service.bus.session import open_client, open_hub
from lumpwatch.service.core.frame import Frame
from tests.bus.test_bus_support import Child, client_config, eventually, free_endpoint, hub_config

FROZEN = 6
ALARMS = 25
NOISE = np.random.default_rng(1).integers(0, 255, (600, 800), np.uint8)


class _Stuck:
    """A zenoh publisher whose hub takes nothing until it is let go."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.sent: list[bytes] = []

    def put(self, payload: bytes, attachment: bytes) -> None:
        self.go.wait()
        self.sent.append(payload)


def test_who_puts_does_not_wait_and_the_order_stays() -> None:
    outbox, stuck = Worker("alarms", 8), _Stuck()
    publisher = Publisher("k", 4, outbox)
    publisher.use(stuck)  # type: ignore[arg-type]
    for number in range(5):
        publisher.put(b"%d" % number)  # returns, or the test would hang
    assert not outbox.idle
    stuck.go.set()
    assert outbox.drain(10.0)
    assert stuck.sent == [b"0", b"1", b"2", b"3", b"4"]
    publisher.close()
    with pytest.raises(BusClosed):
        publisher.put(b"5")
    outbox.close()


def test_the_queue_is_bounded_and_counts_what_it_loses() -> None:
    outbox, stuck = Worker("alarms", 3), _Stuck()
    publisher = Publisher("k", 4, outbox)
    publisher.use(stuck)  # type: ignore[arg-type]
    publisher.put(b"first")
    eventually(lambda: not outbox._jobs)  # it is being sent
    for number in range(5):
        publisher.put(b"%d" % number)
    assert outbox.dropped == 2
    stuck.go.set()
    assert outbox.drain(10.0)
    assert stuck.sent == [b"first", b"2", b"3", b"4"]
    outbox.close()


def test_the_ports_of_tcp_endpoints() -> None:
    endpoints = ("tcp/127.0.0.1:7447", "tls/[::]:7448", "quic/1.2.3.4:1", "unixsock-stream/x", "ws/a.b:80/x")
    assert tcp_ports(endpoints) == {7447, 7448, 80}


@pytest.mark.slow
def test_frozen_readers_are_cut_off_and_alarms_are_in_time() -> None:
    endpoint = free_endpoint()
    arrived: list[tuple[float, bytes]] = []
    with (
        open_hub(hub_config(endpoint, shared_memory=False)) as hub,
        open_client(client_config(endpoint, shared_memory=False), wait=False) as reader,
        open_client(client_config(endpoint, shared_memory=False), wait=False) as monitor,
        contextlib.ExitStack() as stack,
    ):
        reader.subscribe_alarms("s/alarm", lambda _, payload: arrived.append((time.monotonic(), payload)))
        frames, alarms = monitor.frame_publisher("s/frame"), monitor.alarm_publisher("s/alarm")
        frozen = [stack.enter_context(Child("listen", endpoint, "s/**")) for _ in range(FROZEN)]
        alarms.put(b"0 0")
        eventually(lambda: arrived)
        for child in frozen:
            child.process.send_signal(signal.SIGSTOP)
        cut: list[CutOff] = []
        longest_s = 0.0
        for number in range(1, ALARMS + 1):
            for _ in range(4):
                now = time.monotonic()
                frames.publish(Frame(number, now, now, now, 800, 600, "gray8", NOISE))
                time.sleep(0.04)
            before = time.monotonic()
            alarms.put(b"%d %f" % (number, before))
            longest_s = max(longest_s, time.monotonic() - before)
            cut += hub.cut_off()
        eventually(lambda: len(arrived) == ALARMS + 1)
        numbers = [int(payload.split()[0]) for _, payload in arrived]
        late_s = max(at - float(payload.split()[1]) for at, payload in arrived[1:])
        assert numbers == sorted(numbers)
        assert len({session.peer for session in cut}) == FROZEN
        assert {session.burden for session in cut} == {Burden.SLOW}
    assert longest_s < 0.2, "the one that decides waited for readers"
    assert late_s < 2.0, "with zenoh's own values it is 10 to 20 s"
