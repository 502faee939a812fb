"""A worker's line that is reset: a fault while it works, nothing to speak of where it was asked to end."""

from __future__ import annotations

import socket
import struct
from multiprocessing.connection import Connection

import pytest

from lumpwatch.service.runtime.report_reader import ReportReader


def reset_line() -> tuple[Connection, socket.socket]:
    """A connection and the other end, which resets it when it is closed."""
    ours, theirs = socket.socketpair()
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    return Connection(ours.detach()), theirs


@pytest.mark.parametrize("asked", [True, False])
def test_a_reset_line(asked: bool, caplog: pytest.LogCaptureFixture) -> None:
    connection, theirs = reset_line()
    # What the worker never reads makes its end a reset, and not an end.
    connection.send("unread")
    reader = ReportReader(connection, "camera:cam")
    if asked:
        reader.ask_to_stop()
    theirs.close()
    reader.wait_for_end(10.0)
    warned = [record for record in caplog.records if "its line broke" in record.message]
    assert bool(warned) is not asked
