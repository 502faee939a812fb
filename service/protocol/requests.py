"""What operators and the plant may ask on the bus, and what comes back, as models with a schema.

The values of a query stand behind the `?` of its selector, where all are text, or in its payload.
"""

from __future__ import annotations

from typing import Literal

from pydantic import AliasChoices, Field

from lumpwatch.service.core import AlarmClass, AlarmState, Change
from lumpwatch.service.protocol.messages import Record

_NAME, _REASON = 128, 500


class Request(Record):
    """What all requests about an alarm have."""

    alarm_class: AlarmClass = Field(
        default=AlarmClass.LUMP,
        validation_alias=AliasChoices("class", "alarm_class"),
        serialization_alias="class",
    )
    """Which alarm of the ROI."""

    @classmethod
    def names(cls) -> set[str]:
        """The names of its parameters."""
        return {field.serialization_alias or name for name, field in cls.model_fields.items()}


class AckRequest(Request):
    """Acknowledge an alarm."""

    actor: str = Field(max_length=_NAME)
    """Who does it."""


class ResetRequest(Request):
    """Reset an alarm that is latched."""

    actor: str = Field(max_length=_NAME)
    """Who does it."""


class ShelveRequest(Request):
    """Keep an alarm from being announced for a while."""

    actor: str = Field(max_length=_NAME)
    """Who does it."""
    reason: str = Field(max_length=_REASON)
    """Why."""
    for_s: float = Field(gt=0.0)
    """For how long, at most `shelve_max_s`."""


class UnshelveRequest(Request):
    """End the shelving."""

    actor: str = Field(max_length=_NAME)
    """Who does it."""


class ServiceRequest(Request):
    """Take an alarm out of service, or put it back in."""

    actor: str = Field(max_length=_NAME)
    """Who does it."""
    state: Literal["out", "in"]
    """`out` or `in`."""
    reason: str | None = Field(default=None, max_length=_REASON)
    """Why; needed for `out`."""


class SuppressRequest(Request):
    """A plant signal suppresses an alarm for as long as it is valid."""

    signal: str = Field(max_length=_NAME)
    """Name of the signal."""
    valid_s: float = Field(ge=0.0)
    """For how long, at most `suppress_max_s`; 0 ends it."""


class ActReply(Record):
    """What became of a request about an alarm."""

    alarm_class: AlarmClass = Field(
        validation_alias=AliasChoices("class", "alarm_class"), serialization_alias="class"
    )
    """Which alarm of the ROI."""
    changes: tuple[Change, ...]
    """What happened to it; empty: there was nothing to do."""
    alarm: AlarmState
    """Where it stands now."""
    active: bool
    """Whether its condition is active."""
    sequence: int
    """Sequence of the ROI's last alarm record."""
    acknowledged: bool | None = None
    """Whether it was acknowledged by this (`ack` only)."""
