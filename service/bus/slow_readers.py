"""Cuts off sessions that do not read, so that they hold up nobody else.

A router that passes on what must not be lost waits for the receiver, and whoever stands behind that waits too: some
seconds for each reader that has stopped reading. Worse, zenoh closes such a connection with a linger of 10 s, in the
threads that route. So the system ends a connection by itself that has taken nothing for a second while something
was waiting for it (`TCP_USER_TIMEOUT`, on the listening socket and inherited by all that it accepts): that is
noticed for all slow readers at once, and closing what is already ended does not linger. Who was cut off comes back
by itself once it reads again, and fetches the alarms that it has missed.
"""

from __future__ import annotations

import contextlib
import socket

from lumpwatch.service.bus.connections import Connections

STALLED_S = 1.0
"""A connection that takes nothing for so long, while something waits for it, is ended."""
_PROBES = 3
"""Where `struct tcp_info` counts the probes of a closed window; the byte before counts retransmissions."""


class SlowReaders:
    """Those among some connections that do not read."""

    def __init__(self, connections: Connections) -> None:
        """Sets the limit on the sockets that listen: call it right after they are opened."""
        self._connections = connections
        self._stalled: set[str] = set()
        for connection in connections.sockets():
            _limit(connection)

    def look(self) -> tuple[str, ...]:
        """The peers that have been cut off since the last look; call it some times in `STALLED_S`."""
        stalled, present = set(), set()
        for name, connection in self._connections.peers():
            present.add(name)
            with contextlib.suppress(OSError):
                info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 8)
                if any(info[_PROBES - 1 : _PROBES + 1]):
                    stalled.add(name)
        cut = tuple(sorted(self._stalled - present))
        self._stalled = stalled
        return cut


def _limit(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(STALLED_S * 1000))
