"""The TCP connections of this process on some ports of its own, as the system sees them: zenoh shows no socket.

Linux only; elsewhere, and for endpoints without TCP, there is none here.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Iterable, Iterator
from pathlib import Path

_PORT = re.compile(r"(?:tcp|tls|ws)/.*?:(\d+)(?:[?#/].*)?")


def tcp_ports(endpoints: Iterable[str]) -> frozenset[int]:
    """The ports of those endpoints that are TCP underneath."""
    found = (_PORT.fullmatch(endpoint) for endpoint in endpoints)
    return frozenset(int(match[1]) for match in found if match)


class Connections:
    """The sockets on the ports of some endpoints, listening ones included."""

    def __init__(self, endpoints: Iterable[str], descriptors: Path = Path("/proc/self/fd")) -> None:
        self._ports = tcp_ports(endpoints)
        self._descriptors = descriptors

    def sockets(self) -> Iterator[socket.socket]:
        """A second handle on each socket, open until the next one is asked for."""
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

    def peers(self) -> Iterator[tuple[str, socket.socket]]:
        """The same without those that listen, each with its peer as host:port, an IPv6 host in brackets."""
        for connection in self.sockets():
            with contextlib.suppress(OSError):
                host, port = connection.getpeername()[:2]
                yield (f"[{host}]:{port}" if ":" in host else f"{host}:{port}"), connection


def _second(descriptor: int) -> socket.socket:
    """A second handle. Raises OSError where it is no socket any more."""
    duplicate = os.dup(descriptor)
    try:
        return socket.socket(fileno=duplicate)
    except OSError:
        os.close(duplicate)
        raise
