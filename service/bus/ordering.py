"""Messages of one publisher in order and without holes, whatever the network makes of them.

zenoh's advanced subscriber fetches again what an outage swallowed, but it throws the history of a
publisher away when a live message overtakes it. So publishers number their messages and keep the
last ones, and a receiver that sees a hole asks for what is missing before it goes on.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass

_STAMP = re.compile(rb"([0-9a-f]{16}):(\d{1,18})")


@dataclass(frozen=True, slots=True)
class Message:
    """A message with its publisher and its number there, from 0; an unknown publisher is empty."""

    key: str
    payload: bytes
    publisher: str = ""
    number: int = 0


def stamp(publisher: str, number: int) -> bytes:
    """The attachment that says which publisher (16 hexadecimal digits) sent which message."""
    return f"{publisher}:{number}".encode()


def stamped(key: str, payload: bytes, attachment: bytes) -> Message:
    """A message from the wire; without a valid stamp its publisher is unknown."""
    if (match := _STAMP.fullmatch(attachment)) is None:
        return Message(key, payload)
    return Message(key, payload, match[1].decode(), int(match[2]))


Due = tuple[list[Message], int]
"""Messages to pass on now, and how many before them are lost for good."""


MOST_JUMP = 64
"""A number further ahead of what its publisher is known to have sent is not believed: the message moves nothing."""
_SEEN = 256
_OF_A_NUMBER = 4
_MOST_PUBLISHERS = 4096


class InOrder:
    """Says for each message that arrives which ones are due: each once, in order, holes filled.

    What fills a hole comes from `recent(key)`. When a publisher is seen for the first time, all that can
    still be had is due first, what its predecessors sent included. Messages of unknown publishers are
    due as they come.

    Anyone may send under any name and number, so no message can keep another one out: a number that was had
    keeps out the same message only, and one that leaps ahead is shown without being counted from.
    """

    def __init__(self, recent: Callable[[str], list[Message]]) -> None:
        self._recent = recent
        self._next: dict[str, int] = {}
        self._seen: dict[str, dict[int, tuple[bytes, ...]]] = {}

    def due(self, arrived: Message) -> Due:
        """What is due now that a message has arrived."""
        if not arrived.publisher:
            return [arrived], 0
        expected = self._next.get(arrived.publisher)
        if expected is not None and arrived.number <= expected:
            return self._new([arrived])
        before = [
            message
            for message in self._recent(arrived.key)
            if message.publisher != arrived.publisher or message.number < arrived.number
        ]
        known = [message.number for message in before if message.publisher == arrived.publisher]
        if expected is not None and arrived.number > max([expected, *known]) + MOST_JUMP:
            found, lost = self._new(before)
            return [*found, arrived], lost  # shown, whoever sent it, and not counted from
        return self._new([*before, arrived])

    def catch_up(self, key: str) -> Due:
        """What is due of all that can still be had of a key."""
        return self._new(self._recent(key))

    def _new(self, messages: list[Message]) -> Due:
        """Those that were not due before; publisher by publisher, as they first occur."""
        known = self._next.copy()
        publishers = {message.publisher: i for i, message in reversed(list(enumerate(messages)))}
        found: list[Message] = []
        lost = 0
        for message in sorted(messages, key=lambda message: (publishers[message.publisher], message.number)):
            expected = self._next.get(message.publisher, 0)
            if not message.publisher:
                continue
            if message.number < expected:
                if self._is_another(message):
                    found.append(message)
                continue
            self._remember(message)
            found.append(message)
            if message.publisher in known:
                lost += message.number - expected
            self._next[message.publisher] = message.number + 1
            if len(self._next) > _MOST_PUBLISHERS:
                oldest = next(iter(self._next))
                del self._next[oldest]
                self._seen.pop(oldest, None)
        return found, lost

    def _is_another(self, message: Message) -> bool:
        """Whether another message was had under the same number: one of the two is forged, so both are shown."""
        seen = self._seen.get(message.publisher, {})
        if message.number not in seen or _digest(message) in seen[message.number]:
            return False
        self._remember(message)
        return True

    def _remember(self, message: Message) -> None:
        seen = self._seen.setdefault(message.publisher, {})
        seen[message.number] = (*seen.get(message.number, ()), _digest(message))[-_OF_A_NUMBER:]
        if len(seen) > _SEEN:
            del seen[min(seen)]


def _digest(message: Message) -> bytes:
    return hashlib.blake2b(message.payload, digest_size=8).digest()
