"""No descriptors left, and clients that do not go: the daemon goes on, and comes back."""

from __future__ import annotations

import contextlib
import errno
import signal
import socket
import threading
import urllib.request
from multiprocessing.connection import Connection

import numpy as np
import pytest
from prometheus_client import CollectorRegistry

from lumpwatch.service.capture.sources.base import Fault
from lumpwatch.service.capture.sources.reconnect import Reconnecting
from lumpwatch.service.config.source import BackoffConfig
from lumpwatch.service.runtime.ends import how_ended
from lumpwatch.service.runtime.supervisor import Process, Supervisor, Task
from lumpwatch.service.telemetry import Relay, TelemetryServer
from lumpwatch.service.telemetry.http import MOST_CONNECTIONS
from tests.bus.test_bus_support import eventually
from tests.runtime.fakes import FakeClock


def test_a_worker_that_cannot_be_started_is_tried_again() -> None:
    clock, tried = FakeClock(), 0

    def start(task: Task) -> tuple[Process, Connection]:
        nonlocal tried
        tried += 1
        raise OSError(errno.EMFILE, "Too many open files")

    task = Task("cam", "camera", lambda: None, (), 10.0)
    supervisor = Supervisor([task], Relay(), lambda *_: None, start=start, clock=clock)
    for _ in range(3):
        supervisor.watch()
        supervisor.watch()  # not before the pause is over
        clock.now_s += 20.0
    assert tried == 3


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (-signal.SIGBUS, "SIGBUS: /dev/shm"),
        (-signal.SIGKILL, "SIGKILL: no memory was left, or somebody killed it"),
        (-signal.SIGHUP, "SIGHUP"),
        (-60, "signal 60"),
        (3, "exit code 3"),
        (None, "exit code None"),
    ],
)
def test_how_a_worker_ended_is_said_in_words(code: int | None, words: str) -> None:
    assert how_ended(code).startswith(words)


class _Healthy:
    def live(self) -> list[str]:
        return []

    ready = started = live


def test_idle_connections_do_not_use_up_the_daemon() -> None:
    with (
        TelemetryServer(("127.0.0.1", 0), CollectorRegistry(), _Healthy()) as server,
        contextlib.ExitStack() as stack,
    ):
        port = int(server.url.rpartition(":")[2])
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
            for _ in range(MOST_CONNECTIONS + 20)
        ]

        def refused() -> int:
            count = 0
            for one in idle:
                one.setblocking(False)
                with contextlib.suppress(BlockingIOError, ConnectionError):
                    count += one.recv(1) == b""
            return count

        eventually(lambda: refused() >= 20)
        for one in idle:
            one.close()

        def answers() -> bool:
            with (
                contextlib.suppress(OSError),
                urllib.request.urlopen(f"{server.url}/livez", timeout=2) as reply,
            ):
                return bool(reply.status == 200)
            return False

        eventually(answers)


class _Odd:
    """A camera whose answer is something that nobody has thought of."""

    nominal_fps = length = None
    opened = 0

    def open(self) -> None:
        self.opened += 1
        raise UnicodeDecodeError("utf-8", b"\xc9", 0, 1, "secret://password")

    def read(self) -> None:
        return None

    def close(self) -> None:
        pass


class _Faults:
    def __init__(self) -> None:
        self.seen: list[Fault] = []

    def attempt(self) -> None:
        pass

    connected = attempt

    def failed(self, fault: Fault) -> None:
        self.seen.append(fault)

    dropped = failed


def test_nothing_that_a_camera_answers_ends_its_process() -> None:
    stop, faults, odd = threading.Event(), _Faults(), _Odd()

    def sleep(_: float) -> None:
        if odd.opened == 3:
            stop.set()

    source = Reconnecting(odd, BackoffConfig(), stop, faults, np.random.default_rng(1), sleep)
    assert source.read() is None
    assert faults.seen == [Fault.UNEXPECTED] * 3
