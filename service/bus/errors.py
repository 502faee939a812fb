"""What can go wrong on the bus."""

from __future__ import annotations

from enum import StrEnum

from lumpwatch.service.errors import LumpwatchError


class BusError(LumpwatchError):
    """The bus cannot be opened or used; the text names the endpoint or the key."""


class BusClosed(BusError):  # noqa: N818 - an event rather than an error
    """The bus was closed, or the wait for it was stopped."""


class Malformation(StrEnum):
    """What is wrong with a message; the words serve as metric labels."""

    NO_HEADER = "no_header"
    HEADER_TOO_LONG = "header_too_long"
    BAD_HEADER = "bad_header"
    UNKNOWN_VERSION = "unknown_version"
    BAD_SHAPE = "bad_shape"
    BAD_LENGTH = "bad_length"
    BAD_JPEG = "bad_jpeg"


class MalformedMessage(BusError):  # noqa: N818 - says what was found
    """A message that does not keep the contract; `reason` says in a word how."""

    def __init__(self, reason: Malformation) -> None:
        super().__init__(f"malformed message: {reason.replace('_', ' ')}")
        self.reason = reason
