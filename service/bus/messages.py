"""Small messages: publishers, answers to queries, and the types of callbacks."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import quote, unquote

import zenoh
from zenoh.ext import AdvancedPublisher

from service.bus.errors import BusClosed
from service.bus.link import Handle
from service.errors import LumpwatchError

_log = logging.getLogger(__name__)

Callback = Callable[[str, bytes], None]
"""Receives key and payload."""
AliveCallback = Callable[[str, bool], None]
"""Receives the key of a liveliness token and whether it is there."""
Handler = Callable[[dict[str, str], bytes | None], bytes]
"""Answers a query: parameters and payload to the reply's payload; an exception becomes an error reply."""


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer to a query: `payload`, or one line of `error`. An error has the key that was asked."""

    key: str
    payload: bytes | None = None
    error: str | None = None


class Publisher(Handle):
    """Publishes small messages on one key; made by `Bus.publisher` and `Bus.alarm_publisher`."""

    def __init__(self, key: str, publisher: AdvancedPublisher) -> None:
        super().__init__()
        self._key = key
        self._publisher = publisher
        self._last: bytes | None = None

    def put(self, payload: bytes) -> None:
        """Send; raises BusClosed when the bus, or this publisher, is closed."""
        self._last = payload
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise BusClosed(f"bus: closed while {self._key} was published") from error

    def answer(self, query: zenoh.Query) -> None:
        """Reply with the last value, if there is one (for the bus only)."""
        with query:
            if self._last is not None:
                query.reply(self._key, self._last)


def answer(key: str, handler: Handler, query: zenoh.Query) -> None:
    """Reply on `key` with what the handler returns, or with one line of error."""
    with query:
        payload = query.payload
        try:
            result = handler(
                from_wire(str(query.parameters)), None if payload is None else payload.to_bytes()
            )
        except LumpwatchError as error:
            query.reply_err(_one_line(str(error)))
        except Exception as error:
            _log.exception("%s: the query failed", key)
            query.reply_err(_one_line(f"{type(error).__name__}: {error}"))
        else:
            query.reply(key, result)


def to_reply(asked: str, reply: zenoh.Reply) -> Reply:
    """A zenoh reply in our own terms."""
    if (sample := reply.ok) is not None:
        return Reply(str(sample.key_expr), payload=sample.payload.to_bytes())
    error = reply.err.payload.to_bytes().decode(errors="replace") if reply.err is not None else ""
    return Reply(asked, error=_one_line(error) or "unknown error")


def to_wire(parameters: dict[str, str]) -> str:
    """Parameters as they stand behind the `?` of a selector: percent-encoded, joined by semicolons."""
    return ";".join(f"{quote(name, safe='')}={quote(value, safe='')}" for name, value in parameters.items())


def from_wire(text: str) -> dict[str, str]:
    """The reverse of `to_wire`; a name without `=` has the empty value."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    return {unquote(name): unquote(value) for name, _, value in pairs}


def _one_line(text: str) -> str:
    return " ".join(text.split())[:500]
