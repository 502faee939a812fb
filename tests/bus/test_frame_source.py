"""One key, one publisher: a second one is refused and counted, a successor taken."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from lumpwatch.service.bus import codec
from lumpwatch.service.bus.errors import MalformedMessage
from lumpwatch.service.bus.frames import HANDOVER_S, FrameInbox
from tests.bus.test_bus_support import gray

A, B = "a" * 16, "b" * 16


class _Bytes(bytes):
    """What zenoh hands over."""

    def to_bytes(self) -> bytes:
        return bytes(self)

    def as_shm(self) -> None:
        return None


@dataclass
class _Sample:
    payload: _Bytes
    attachment: _Bytes | None


class _World:
    def __init__(self) -> None:
        self.now_s = 100.0
        self.inbox = FrameInbox("here", lambda: self.now_s)

    def send(self, seq: int, source: str, *, cut: int = 0) -> int | None:
        """Send one and take what is there; the number of the frame."""
        payload, header = codec.encode_frame(gray(seq), "here", source)
        self.inbox.receive(_Sample(_Bytes(payload[cut:]), _Bytes(header)))  # type: ignore[arg-type]
        frame = self.inbox.take(0.0)
        return None if frame is None else frame.seq


def test_a_second_publisher_is_refused_and_counted() -> None:
    world = _World()
    for seq in range(5):
        assert world.send(seq, A) == seq
        assert world.send(100 + seq, B) is None
        assert world.send(200 + seq, "") is None  # without a name: another one
        world.now_s += 0.04
    assert world.inbox.foreign == 10
    assert world.inbox.source == A


@pytest.mark.parametrize("successor", [B, ""])
def test_a_successor_is_taken_when_the_first_is_silent(successor: str) -> None:
    world = _World()
    assert world.send(0, A) == 0
    world.now_s += HANDOVER_S - 0.1
    assert world.send(1, successor) is None
    world.now_s += 0.2
    assert world.send(2, successor) == 2
    assert world.send(3, A) is None  # it is the successor's key now
    assert world.inbox.foreign == 2


def test_who_sends_nothing_good_keeps_nobody_out() -> None:
    world = _World()
    assert world.send(0, B, cut=1) is None
    assert world.inbox.malformed.total() == 1
    assert world.send(1, A) == 1
    assert world.send(2, B, cut=1) is None
    assert world.inbox.foreign == 1


def test_a_forged_name_in_the_header_is_no_way_past_the_checks() -> None:
    _, header = codec.encode_frame(gray(0), "here", A)
    assert codec.decode_header(header).source == codec.source_of(header) == A
    with pytest.raises(MalformedMessage):
        codec.decode_header(header.replace(A.encode(), b"X" * 16))
