"""Sessions that may only read: those that say too much, and those that are too many, are cut off; others never."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest

from lumpwatch.service.bus.connections import Connections
from lumpwatch.service.bus.guests import BURST, RATE, Guests
from tests.bus.test_bus_support import eventually


class Port:
    """A port, those who have connected to it, and the bound under test."""

    def __init__(self, most: int = 10) -> None:
        self.now_s = 100.0
        self.names: dict[str, str] = {}
        self.listening = socket.create_server(("127.0.0.1", 0))
        address = f"tls/127.0.0.1:{self.listening.getsockname()[1]}"
        self.accepted: dict[str, socket.socket] = {}
        self.guests = Guests(
            Connections((address,)), self.names.items, ("lumpwatch",), most, lambda: self.now_s
        )

    def join(self, name: str) -> tuple[str, socket.socket]:
        """Who connects; gives what it is called by and its socket."""
        client = socket.create_connection(self.listening.getsockname())
        server, (host, port) = self.listening.accept()
        self.accepted[f"{host}:{port}"] = server
        self.names[f"{host}:{port}"] = name
        return f"{host}:{port}", client

    def say(self, who: tuple[str, socket.socket], count: int) -> None:
        """Send so many bytes, and have them read."""
        peer, client = who
        while count > 0:
            piece = min(count, 1 << 16)
            client.sendall(bytes(piece))
            server = self.accepted[peer]
            left = piece
            while left:
                left -= len(server.recv(left))
            count -= piece

    def close(self) -> None:
        for one in (self.listening, *self.accepted.values()):
            one.close()


@pytest.fixture
def port() -> Iterator[Port]:
    with contextlib.closing(Port()) as made:
        yield made


def test_a_guest_that_sends_much_is_cut_off_and_a_daemon_is_not(port: Port) -> None:
    loud, quiet, daemon = port.join("guest"), port.join("guest"), port.join("lumpwatch")
    assert port.guests.look() == ()
    port.say(quiet, BURST - 1)
    port.say(loud, BURST + 1)
    port.say(daemon, 2 * BURST)
    assert port.guests.look() == ((loud[0], "guest"),)
    assert loud[1].recv(1) == b""
    assert port.guests.look() == ()
    port.say(daemon, 1)


def test_what_is_sent_in_time_is_no_burden(port: Port) -> None:
    guest = port.join("guest")
    port.say(guest, BURST)
    assert port.guests.look() == ()
    for _ in range(3):
        port.now_s += 1.0
        port.say(guest, RATE)
        assert port.guests.look() == ()
    port.say(guest, RATE)
    assert port.guests.look() == ((guest[0], "guest"),)


def test_of_too_many_guests_the_newest_go() -> None:
    with contextlib.closing(Port(most=2)) as port:
        first, second = port.join("a"), port.join("b")
        assert port.guests.look() == ()
        port.join("lumpwatch")
        third = port.join("a")
        assert port.guests.look() == ((third[0], "a"),)
        first[1].close()
        port.accepted[first[0]].close()
        fourth = port.join("a")
        assert port.guests.look() == ()
        for guest in (second, fourth):
            port.say(guest, 1)


def test_a_peer_by_ipv6_is_told_apart() -> None:
    try:
        listening = socket.create_server(("::1", 0), family=socket.AF_INET6)
    except OSError:
        pytest.skip("this host has no IPv6")
    with listening, socket.create_connection(listening.getsockname()[:2]) as client, listening.accept()[0]:
        connections = Connections((f"tls/[::1]:{listening.getsockname()[1]}",))
        eventually(lambda: list(connections.peers()))
        assert [peer for peer, _ in connections.peers()] == [f"[::1]:{client.getsockname()[1]}"]
