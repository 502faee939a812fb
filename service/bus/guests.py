"""Bounds what sessions that may only read, or give commands, can make the hub hold.

Access control judges a message when it has all of it: until then its pieces lie in the hub, up to the longest message
for each of a session's priorities. Guests have little to say, so one that sends much is cut off before much is there:
it spends a `BURST` and gets `RATE` a second back. Their number is bounded as well, so that they leave room for the
daemon's own sessions.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from lumpwatch.service.bus.connections import Connections

BURST = 4 << 20
"""Bytes that a guest may send at once: the longest that a command carries is some kilobytes."""
RATE = 64 << 10
"""Bytes a second that a guest may send for long."""
_RECEIVED = struct.Struct("=128xQ")
"""`struct tcp_info` up to the bytes that were received."""


@dataclass(slots=True)
class _Guest:
    """What one connection has sent, and what it may still send."""

    sent: int
    left: float = BURST
    gone: bool = False
    """Cut off, and not closed by zenoh yet."""


class Guests:
    """The connections whose peers are not among those that may say everything."""

    def __init__(
        self,
        connections: Connections,
        names: Callable[[], Iterable[tuple[str, str]]],
        trusted: Iterable[str],
        most: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`names` gives peer (host:port) and common name of each session; `most` guests may be there at once."""
        self._connections = connections
        self._names = names
        self._trusted = frozenset(trusted)
        self._most = most
        self._clock = clock
        self._looked_s = clock()
        self._guests: dict[str, _Guest] = {}
        """Oldest first."""

    def look(self) -> tuple[tuple[str, str], ...]:
        """Cut off those that say too much, or are too many; gives peer and common name of each. Call it often."""
        now = self._clock()
        earned, self._looked_s = RATE * (now - self._looked_s), now
        named = {peer: name for peer, name in self._names() if name not in self._trusted}
        sent = {peer: _sent(one) for peer, one in self._connections.peers() if peer in named}
        self._guests = {peer: guest for peer, guest in self._guests.items() if peer in sent}
        for peer, total in sent.items():
            guest = self._guests.setdefault(peer, _Guest(sent=0))
            guest.left = min(float(BURST), guest.left + earned) - (total - guest.sent)
            guest.sent = total
        here = {peer: guest for peer, guest in self._guests.items() if not guest.gone}
        loud = {peer for peer, guest in here.items() if guest.left < 0}
        too_many = set([peer for peer in here if peer not in loud][self._most :])
        return tuple((peer, named[peer]) for peer in self._cut_off(loud | too_many))

    def _cut_off(self, peers: set[str]) -> list[str]:
        if not peers:
            return []
        for peer, connection in self._connections.peers():
            if peer in peers:
                with contextlib.suppress(OSError):  # it has left by itself
                    connection.shutdown(socket.SHUT_RDWR)
                self._guests[peer].gone = True
        return sorted(peers)


def _sent(connection: socket.socket) -> int:
    """Bytes that came on a connection; 0 where the system does not count them."""
    try:
        (received,) = _RECEIVED.unpack(
            connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _RECEIVED.size)
        )
    except (OSError, struct.error):
        return 0
    return int(received)
