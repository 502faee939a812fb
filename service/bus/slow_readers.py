"""Cuts off sessions that do not read, so that they hold up nobody else.

A router that passes on what must not be lost waits for the receiver, and whoever stands behind that waits too: some
seconds for each reader that has stopped reading. Worse, zenoh closes such a connection with a linger of 10 s, in the
threads that route. So the system ends a connection by itself that has taken nothing for a second while something
was waiting for it (`TCP_USER_TIMEOUT`, on the listening socket and inherited by all that it accepts): that is
noticed for all slow readers at once, and closing what is already ended does not linger. Who was cut off comes back
by itself once it reads again, and fetches the alarms that it has missed.

Linux only; elsewhere, and for endpoints without TCP, nothing is cut off here.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Iterable, Iterator
from pathlib import Path

STALLED_S = 1.0
"""A connection that takes nothing for so long, while something waits for it, is ended."""
_PORT = re.compile(r"(?:tcp|tls|ws)/.*?:(\d+)(?:[?#/].*)?")
_PROBES = 3
"""Where `struct tcp_info` counts the probes of a closed window; the byte before counts retransmissions."""


def tcp_ports(endpoints: Iterable[str]) -> frozenset[int]:
    """The ports of those endpoints that are TCP underneath."""
    found = (_PORT.fullmatch(endpoint) for endpoint in endpoints)
    return frozenset(int(match[1]) for match in found if match)


class SlowReaders:
    """The connections of this process on some ports of its own."""

    def __init__(self, endpoints: Iterable[str], descriptors: Path = Path("/proc/self/fd")) -> None:
        """Sets the limit on the listening sockets of these endpoints: call it right after they are opened."""
        self._ports = tcp_ports(endpoints)
        self._descriptors = descriptors
        self._stalled: set[str] = set()
        for connection in self._sockets():
            _limit(connection)

    def look(self) -> tuple[str, ...]:
        """The peers that have been cut off since the last look; call it some times in `STALLED_S`."""
        stalled, present = set(), set()
        for connection in self._sockets():
            with contextlib.suppress(OSError):
                host, port = connection.getpeername()[:2]
                name = f"{host}:{port}"
                present.add(name)
                info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 8)
                if any(info[_PROBES - 1 : _PROBES + 1]):
                    stalled.add(name)
        cut = tuple(sorted(self._stalled - present))
        self._stalled = stalled
        return cut

    def _sockets(self) -> Iterator[socket.socket]:
        """A second handle on each socket of the ports, open until the next one is asked for."""
        if not self._ports or not hasattr(socket, "TCP_USER_TIMEOUT"):
            return
        try:
            entries = list(self._descriptors.iterdir())
        except OSError:
            return
        for entry in entries:
            try:
                if not entry.is_socket():
                    continue
                connection = _second(int(entry.name))
            except OSError:  # closed meanwhile
                continue
            with connection:
                try:
                    ours = (
                        connection.family in (socket.AF_INET, socket.AF_INET6)
                        and connection.type == socket.SOCK_STREAM
                        and connection.getsockname()[1] in self._ports
                    )
                except (OSError, IndexError, TypeError):
                    continue
                if ours:
                    yield connection


def _second(descriptor: int) -> socket.socket:
    """A second handle. Raises OSError where it is no socket any more."""
    duplicate = os.dup(descriptor)
    try:
        return socket.socket(fileno=duplicate)
    except OSError:
        os.close(duplicate)
        raise


def _limit(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(STALLED_S * 1000))
