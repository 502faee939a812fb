"""What can be wrong with clips."""

from __future__ import annotations

from lumpwatch.service.errors import LumpwatchError


class ClipError(LumpwatchError):
    """A clip cannot be taken or changed; the text says why."""


class LabelConflictError(ClipError):
    """Somebody else has changed the labels meanwhile."""


class VideoError(ClipError):
    """A video cannot be used; the text says why."""


class RecordingError(ClipError):
    """Nothing could be recorded; the text says why."""
