"""Small messages: publishers, answers to queries, and the types of callbacks."""

from __future__ import annotations

import contextlib
import logging
import threading
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from urllib.parse import quote, unquote

import zenoh
from zenoh import ext

from lumpwatch.service.bus.callback_queue import Worker
from lumpwatch.service.bus.errors import BusClosed, BusError
from lumpwatch.service.bus.handles import Handle
from lumpwatch.service.bus.ordering import Message, stamp, stamped
from lumpwatch.service.errors import LumpwatchError

_log = logging.getLogger(__name__)

ALARMS_KEPT = 64
"""How many alarms of one publisher can be had later."""
_HEARTBEAT_S = 0.5

Callback = Callable[[str, bytes], None]
"""Receives key and payload."""
Handler = Callable[[dict[str, str], bytes | None], bytes]
"""Answers a query: parameters and payload to the reply's payload; an exception becomes an error reply."""


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer to a query: `payload`, or one line of `error`. An error has the key that was asked."""

    key: str
    payload: bytes | None = None
    error: str | None = None


class Publisher(Handle):
    """Publishes small messages on one key; made by `Bus.publisher` and `Bus.alarm_publisher`.

    `put` never waits: a thread of the bus sends, one after another in the order of the calls.
    """

    def __init__(self, key: str, keep: int, outbox: Worker, kept: Sequence[Message] = ()) -> None:
        """`outbox` sends; `kept` are messages of former publishers of this key, for late joiners."""
        super().__init__()
        self._outbox = outbox
        self._closed = False
        self.name = uuid.uuid4().hex[:16]
        """Tells this publisher from all others of the key, former ones included."""
        self._key = key
        self._keep = keep
        self._lock = threading.Lock()
        self._next = 0
        self._kept = tuple(kept)[-keep:]
        self._publisher: ext.AdvancedPublisher | None = None

    def use(self, publisher: ext.AdvancedPublisher) -> None:
        """Send by this one (for the bus only)."""
        self._publisher = publisher

    def put(self, payload: bytes, number: int | None = None, publisher: str | None = None) -> None:
        """Have it sent; returns at once. Raises BusClosed when the bus, or this publisher, is closed.

        Messages are numbered from 0 unless `number` is given, which must rise. One with the `publisher`
        that it had before is the same message again: who has had it does not get it twice.
        """
        with self._lock:  # numbers must go out in order
            sent = Message(
                self._key, payload, publisher or self.name, self._next if number is None else number
            )
            if self._closed or self._publisher is None:
                raise BusClosed(f"bus: closed, cannot publish {self._key}")
            if publisher is None:
                self._next = sent.number + 1
            self._kept = (*self._kept, sent)[-self._keep :]
            self._outbox.submit(partial(self._send, self._publisher, sent))

    def close(self) -> None:
        """Take it back; what waits to be sent is not. Idempotent."""
        self._closed = True
        super().close()

    def _send(self, publisher: ext.AdvancedPublisher, sent: Message) -> None:
        """May wait for a slow hub; runs in the outbox."""
        with contextlib.suppress(zenoh.ZError):  # closed meanwhile
            publisher.put(sent.payload, attachment=stamp(sent.publisher, sent.number))

    def answer(self, query: zenoh.Query) -> None:
        """Reply with what is kept, oldest first (for the bus only)."""
        with query:
            for message in self._kept:
                query.reply(self._key, message.payload, attachment=stamp(message.publisher, message.number))


def declare_state(session: zenoh.Session, key: str) -> ext.AdvancedPublisher:
    """Small messages of which the latest counts: dropped where a receiver is slow."""
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=zenoh.Encoding.APPLICATION_JSON,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA,
        cache=ext.CacheConfig(1),
        publisher_detection=True,
    )


def declare_alarms(session: zenoh.Session, key: str) -> ext.AdvancedPublisher:
    """Messages that must not be lost: waits for slow receivers, overtakes frames, repeats what was missed."""
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding="application/cloudevents+json",
        congestion_control=zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.INTERACTIVE_HIGH,
        express=True,
        cache=ext.CacheConfig(ALARMS_KEPT),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
    )


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


def refuse(text: str, query: zenoh.Query) -> None:
    """Reply with one line of error."""
    with query:
        query.reply_err(_one_line(text))


def leave(query: zenoh.Query) -> None:
    """No reply from here: the query is for others."""
    with query:
        pass


def to_message(sample: zenoh.Sample) -> Message:
    """A zenoh sample in our own terms."""
    attachment = sample.attachment
    return stamped(
        str(sample.key_expr), sample.payload.to_bytes(), b"" if attachment is None else attachment.to_bytes()
    )


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
    """The reverse of `to_wire`; a name without `=` has the empty value. Raises BusError for bytes that are no UTF-8."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    try:
        return {unquote(name, errors="strict"): unquote(value, errors="strict") for name, _, value in pairs}
    except UnicodeDecodeError as error:
        raise BusError("the parameters are not UTF-8") from error


def _one_line(text: str) -> str:
    return " ".join(text.split())[:500]
