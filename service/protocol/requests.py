"""What a command may ask, and how a query becomes a request: its model is all that judges it.

The values of a query stand behind the `?` of its selector, where all are text, or in its payload, or a put's, as
the members of a JSON object.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, TypeVar

from pydantic import AliasChoices, BeforeValidator, ConfigDict, Field, StringConstraints, ValidationError
from pydantic_core import PydanticCustomError, from_json

from lumpwatch.service.core import AlarmClass, AlarmRequestError, AlarmState, Change
from lumpwatch.service.protocol.messages import Record


def _one_line(value: object) -> object:
    """Without needless white space. Half a surrogate pair, which JSON can spell, is no text that can be kept."""
    if not isinstance(value, str):
        return value
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise PydanticCustomError("not_utf8", "is not UTF-8") from error
    return " ".join(value.split())


Name = Annotated[str, StringConstraints(min_length=1, max_length=128), BeforeValidator(_one_line)]
"""One line that names someone or something."""
OptionalName = Annotated[str, StringConstraints(max_length=128), BeforeValidator(_one_line)]
"""The same, or nothing."""
Reason = Annotated[str, StringConstraints(min_length=1, max_length=500), BeforeValidator(_one_line)]
"""One line that says why."""
OptionalReason = Annotated[str, StringConstraints(max_length=500), BeforeValidator(_one_line)]
"""The same, or nothing."""


class Request(Record):
    """What a command asks; parameters that it does not know are refused, lest a slip of the pen goes unnoticed."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    @classmethod
    def names(cls) -> list[str]:
        """The names of its parameters."""
        return sorted(field.serialization_alias or name for name, field in cls.model_fields.items())


class AlarmRequest(Request):
    """What all requests about an alarm have."""

    alarm_class: AlarmClass = Field(
        default=AlarmClass.LUMP,
        validation_alias=AliasChoices("class", "alarm_class"),
        serialization_alias="class",
    )
    """Which alarm of the ROI."""


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


_R = TypeVar("_R", bound=Request)


def read_request(model: type[_R], parameters: Mapping[str, object], payload: bytes | None = None) -> _R:
    """The request in a query; where a parameter is in the payload too, the selector's counts.

    Raises AlarmRequestError, whose one line names the parameter.
    """
    try:
        carried = from_json(payload, allow_inf_nan=False) if payload else {}
    except ValueError as error:
        raise AlarmRequestError("the payload is not JSON in UTF-8") from error
    if not isinstance(carried, dict):
        raise AlarmRequestError("the payload is not a JSON object")
    try:
        return model.model_validate(carried | dict(parameters))
    except ValidationError as error:
        raise AlarmRequestError(_error_line(error, model)) from error


def _error_line(error: ValidationError, model: type[Request]) -> str:
    """The first thing that is wrong, in one line."""
    first = error.errors(include_url=False)[0]
    name = " ".join(str(first["loc"][0]).split())[:60] if first["loc"] else ""
    if first["type"] == "extra_forbidden":
        has = ", ".join(model.names())
        return f"{name}: is no parameter of this command ({f'has {has}' if has else 'it has none'})"
    if first["type"] == "missing" or (first["type"] == "string_too_short" and not first["input"].split()):
        return f"{name}: is missing"
    message = first["msg"][0].lower() + first["msg"][1:]
    return f"{name}: {message}" if name else message
