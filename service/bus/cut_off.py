"""Which sessions a hub cuts off, and why."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import NamedTuple

import zenoh

from lumpwatch.service.bus.connections import Connections
from lumpwatch.service.bus.guests import Guests
from lumpwatch.service.bus.slow_readers import SlowReaders
from lumpwatch.service.config import BusConfig

_PEER = re.compile(r"(?:tcp|tls|ws)/(\S+?:\d+)(?:[?#/].*)?")


class Burden(StrEnum):
    """Why a session was cut off."""

    SLOW = "slow"
    """It did not read what waited for it."""
    LOUD = "loud"
    """It may only read or give commands, and sent too much; or there were too many of its kind."""


class CutOff(NamedTuple):
    """A session that was cut off."""

    peer: str
    """Address and port that it came from."""
    name: str
    """The common name of its certificate, where that is known."""
    burden: Burden


def watch_sessions(
    session: zenoh.Session, listen: tuple[str, ...], config: BusConfig
) -> Callable[[], tuple[CutOff, ...]]:
    """What cuts off sessions of this hub when it is called; `listen` is what it listens on."""
    connections = Connections(listen)
    slow = SlowReaders(connections)
    # Without rules of access everybody may say everything.
    guests = config.access and Guests(
        connections, lambda: _names(session), config.access.daemons, config.hub.guests
    )

    def look() -> tuple[CutOff, ...]:
        loud = guests.look() if guests else ()
        return (
            *(CutOff(peer, "", Burden.SLOW) for peer in slow.look()),
            *(CutOff(peer, name, Burden.LOUD) for peer, name in loud),
        )

    return look


def _names(session: zenoh.Session) -> Iterator[tuple[str, str]]:
    """Peer and common name of each session."""
    for link in session.info.links():
        if (found := _PEER.fullmatch(str(link.dst))) is not None:
            yield found[1], link.auth_identifier or ""
