from __future__ import annotations

import logging
from collections.abc import Callable
from threading import Event

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.reconnect import Backoff, Reconnecting, StreamState
from lumpwatch.service.config.source import BackoffConfig
from lumpwatch.service.core.frame import Frame

F = Frame(0, 0.0, 0.0, 0.0, 2, 2, "gray8", np.zeros((2, 2), np.uint8))
CONNECTED = "connected"


class ScriptedSource:
    """Each entry is one connection: a fault at open, or what its reads give."""

    nominal_fps = 25.0
    length = None

    def __init__(self, *connections: Fault | list[Frame | Fault | None]) -> None:
        self._connections = list(connections)
        self._reads: list[Frame | Fault | None] = []
        self.closed = 0

    def open(self) -> None:
        connection = self._connections.pop(0)
        if isinstance(connection, Fault):
            raise SourceError(connection, f"cannot open: {connection}")
        self._reads = list(connection)

    def read(self) -> Frame | None:
        item = self._reads.pop(0)
        if isinstance(item, Fault):
            raise SourceError(item, f"cannot read: {item}")
        return item

    def close(self) -> None:
        self.closed += 1


class Log:
    def __init__(self) -> None:
        self.events: list[str] = []

    def attempt(self) -> None:
        self.events.append("attempt")

    def connected(self) -> None:
        self.events.append(CONNECTED)

    def failed(self, fault: Fault) -> None:
        self.events.append(f"failed {fault}")

    def dropped(self, reason: Fault) -> None:
        self.events.append(f"dropped {reason}")


class Rig:
    def __init__(self, *connections: Fault | list[Frame | Fault | None]) -> None:
        self.source = ScriptedSource(*connections)
        self.stop = Event()
        self.log = Log()
        self.pauses: list[float] = []
        self.on_pause: Callable[[], object] = lambda: None
        config = BackoffConfig(initial_s=1.0, max_s=5.0, jitter=0.0)
        rng = np.random.default_rng(1)
        self.stream = Reconnecting(self.source, config, self.stop, self.log, rng, self._sleep)

    def _sleep(self, pause: float) -> None:
        assert self.stream.state is StreamState.WAITING
        self.pauses.append(pause)
        self.on_pause()


def test_pauses_grow_and_are_reset_by_a_frame_only() -> None:
    refused = Fault.UNREACHABLE
    rig = Rig(refused, [Fault.READ_TIMEOUT], refused, refused, [F, Fault.ENDED], refused, [F])
    assert rig.stream.read() is F
    assert rig.pauses == [1.0, 2.0, 4.0, 5.0]
    assert rig.stream.state is StreamState.RUNNING
    assert rig.stream.read() is F
    assert rig.pauses[4:] == [1.0, 2.0]
    assert rig.log.events == [
        "attempt", "failed unreachable", "attempt", "failed read_timeout", "attempt", "failed unreachable",
        "attempt", "failed unreachable", "attempt", CONNECTED, "dropped ended",
        "attempt", "failed unreachable", "attempt", CONNECTED,
    ]  # fmt: skip


def test_a_finite_source_ends_and_is_not_opened_again() -> None:
    rig = Rig([F, F, None])
    assert list(rig.stream) == [F, F]
    assert rig.stream.state is StreamState.ENDED
    assert rig.stream.read() is None
    assert rig.log.events == ["attempt", CONNECTED]
    assert rig.source.closed == 1


def test_an_ended_stream_can_be_closed() -> None:
    rig = Rig([None])
    assert rig.stream.read() is None
    rig.stream.close()
    assert rig.stream.state is StreamState.CLOSED


def test_a_change_of_size_is_reported_and_the_stream_goes_on() -> None:
    rig = Rig([F, Fault.SIZE_CHANGED], [F, None])
    assert list(rig.stream) == [F, F]
    assert rig.log.events == ["attempt", CONNECTED, "dropped size_changed", "attempt", CONNECTED]


def test_stop_during_a_pause_closes() -> None:
    rig = Rig(Fault.NOT_FOUND)
    rig.on_pause = rig.stop.set
    assert rig.stream.read() is None
    assert rig.stream.state is StreamState.CLOSED
    assert rig.stream.read() is None


def test_stop_ends_the_default_pause_at_once() -> None:
    class StopAtFault(Log):
        def failed(self, fault: Fault) -> None:
            stop.set()

    stop = Event()
    backoff = BackoffConfig(initial_s=3600.0, max_s=3600.0)
    stream = Reconnecting(
        ScriptedSource(Fault.NOT_FOUND), backoff, stop, StopAtFault(), np.random.default_rng(1)
    )
    assert stream.read() is None  # would last an hour


def test_close_is_idempotent_and_final() -> None:
    rig = Rig([F])
    rig.stream.close()
    rig.stream.close()
    assert rig.stream.read() is None
    assert rig.log.events == []


def test_a_lasting_fault_is_logged_once_and_its_end_too(caplog: pytest.LogCaptureFixture) -> None:
    lost, missing = Fault.UNREACHABLE, Fault.NOT_FOUND
    rig = Rig(missing, missing, missing, lost, missing, [F, None])
    with caplog.at_level(logging.INFO):
        list(rig.stream)
    assert caplog.messages == [
        "cannot open: not_found",
        "cannot open: unreachable",
        "cannot open: not_found",
        "frames again after not_found",
    ]


@given(st.floats(0.01, 10.0), st.floats(1.0, 100.0), st.floats(0.0, 1.0), st.integers(0, 2**32))
def test_pauses_stay_within_their_bounds(initial: float, factor: float, jitter: float, seed: int) -> None:
    config = BackoffConfig(initial_s=initial, max_s=initial * factor, jitter=jitter)
    backoff = Backoff(config, np.random.default_rng(seed))
    for i in range(12):
        full = min(initial * 2**i, config.max_s)
        assert full * (1 - jitter) <= backoff.next() <= full
