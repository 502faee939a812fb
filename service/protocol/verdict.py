"""Verdicts: how people judge an alarm afterwards."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from lumpwatch.service.protocol.messages import Record
from lumpwatch.service.protocol.requests import Name, OptionalReason, Request


class VerdictOutcome(StrEnum):
    """Whether an alarm was justified, as an operator judges it."""

    TRUE = "true"
    FALSE = "false"
    UNSURE = "unsure"


class VerdictRequest(Request):
    """Say whether a lump alarm was one; without `alarm` and `evidence` the last one is meant."""

    actor: Name
    """Who says it."""
    verdict: VerdictOutcome
    """What the alarm was."""
    alarm: Name | int | None = None
    """Sequence or id of any of its records."""
    evidence: Name | None = None
    """Id of its evidence."""
    note: OptionalReason = ""
    """Why."""

    @model_validator(mode="after")
    def _one_alarm(self) -> Self:
        if self.alarm is not None and self.evidence is not None:
            raise PydanticCustomError("twice", "alarm: is given as well as evidence; one of them is enough")
        return self


class VerdictReply(Record):
    """What became of a verdict."""

    verdict: VerdictOutcome
    """What was said."""
    sequence: int
    """Sequence of the record that raised the alarm."""
    alarm: str
    """Id of that record."""
    written: bool
    """Whether it is on the disk; else it will be, as soon as the disk takes it."""
