"""Messages of one publisher in order and without holes, whatever the network makes of them.

zenoh's advanced subscriber fetches again what an outage swallowed, but it throws the history of a
publisher away when a live message overtakes it. So publishers number their messages and keep the
last ones, and a receiver that sees a hole asks for what is missing before it goes on.
"""

from __future__ import annotations

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


class InOrder:
    """Says for each message that arrives which ones are due: each once, in order, holes filled.

    What fills a hole comes from `recent(key)`. Of a publisher not seen before, all that can still be
    had is due first. Messages of unknown publishers are due as they come.
    """

    def __init__(self, recent: Callable[[str], list[Message]]) -> None:
        self._recent = recent
        self._next: dict[str, int] = {}

    def due(self, arrived: Message) -> tuple[list[Message], int]:
        """The messages to pass on now, and how many before them are lost for good."""
        if not arrived.publisher:
            return [arrived], 0
        known = arrived.publisher in self._next
        expected = self._next.get(arrived.publisher, 0)
        if arrived.number < expected:
            return [], 0
        found = {arrived.number: arrived}
        if arrived.number > expected:
            for kept in self._recent(arrived.key):
                if kept.publisher == arrived.publisher and expected <= kept.number < arrived.number:
                    found[kept.number] = kept
        self._next[arrived.publisher] = arrived.number + 1
        lost = arrived.number + 1 - expected - len(found) if known else 0
        return [found[number] for number in sorted(found)], lost
