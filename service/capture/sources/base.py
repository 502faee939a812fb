"""The protocol of a source of frames, and the faults that it names."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

from lumpwatch.service.core import Frame
from lumpwatch.service.errors import LumpwatchError


class Fault(StrEnum):
    """What can be wrong with a source; the names appear as `reason` in metrics and messages."""

    UNREACHABLE = "unreachable"
    UNAUTHORISED = "unauthorised"
    CERTIFICATE = "certificate"
    NOT_FOUND = "not_found"
    NO_PERMISSION = "no_permission"
    OPEN_TIMEOUT = "open_timeout"
    READ_TIMEOUT = "read_timeout"
    CODEC = "codec"
    EMPTY = "empty"
    CORRUPT = "corrupt"
    NO_KEY_FRAME = "no_key_frame"
    FROZEN_PTS = "frozen_pts"
    STALE = "stale"
    SIZE_CHANGED = "size_changed"
    ENDED = "ended"
    UNEXPECTED = "unexpected"


class SourceError(LumpwatchError):
    """A source cannot go on; `fault` says why in a word, the text names the (redacted) source."""

    def __init__(self, fault: Fault, message: str) -> None:
        super().__init__(message)
        self.fault = fault


class Source(Protocol):
    """A producer of frames.

    `open` connects, `read` returns the next frame or None at the end of a finite source, `close`
    may be called in any state and more than once. `open` and `read` raise SourceError and return
    within the configured time-outs. After an error or the end the source may be opened again.
    """

    def open(self) -> None:
        """Connect; raises SourceError."""

    def read(self) -> Frame | None:
        """The next frame; None at the end of a finite source; raises SourceError."""

    def close(self) -> None:
        """Release everything; idempotent."""

    @property
    def nominal_fps(self) -> float | None:
        """Frames a second as the source states them, once it is open."""

    @property
    def length(self) -> int | None:
        """Number of frames of a finite source where it is known, for progress bars."""
