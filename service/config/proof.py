"""When a ROI is tested with a synthetic lump."""

from __future__ import annotations

import re
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from lumpwatch.service.config.base import Delay, PositiveSeconds, Strict

_CLOCK = re.compile(r"([01]\d|2[0-3]):[0-5]\d")
_Long = Annotated[float, Field(ge=60.0, le=31 * 86_400.0)]


class ProofTestConfig(Strict):
    """Proof tests; without `every_s` and `at` by command only."""

    every_s: _Long | None = None
    """A test this long after the last one."""
    at: Annotated[tuple[str, ...], Field(min_length=1, max_length=48)] | None = None
    """Times of day (UTC, HH:MM) of the tests, instead of `every_s`."""
    least_warning_s: Delay = 0.0
    """The test fails where the alarm comes fewer seconds before the lump is at the lip (the end of the ROI)."""
    lump: Literal["labelled", "drawn"] = "labelled"
    """What is shown: the labelled lumps that the prior in use was trained on, in turn and the hardest first, or a drawn
    one. Where the training left no labelled ones, one is drawn."""
    settle_s: PositiveSeconds = 5.0
    """How long the test filter sees the belt before the lump comes."""
    retry_s: PositiveSeconds = 300.0
    """When a test that could not be judged (a real lump came, the ROI was BLIND) is tried again."""
    overdue_after_s: _Long | None = None
    """Without a result for this long the system alarm says so; left out: twice `every_s`, or 30 hours."""

    @field_validator("at")
    @classmethod
    def _times(cls, value: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for time in value or ():
            if not _CLOCK.fullmatch(time):
                raise ValueError(f"'{time}' is not a time of day such as 06:00")
        return value

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if self.every_s is not None and self.at is not None:
            raise ValueError("every_s and at cannot both be given")
        return self

    @property
    def scheduled(self) -> bool:
        """Whether tests come by themselves."""
        return self.every_s is not None or self.at is not None

    @property
    def overdue_s(self) -> float:
        """See `overdue_after_s`."""
        if self.overdue_after_s is not None:
            return self.overdue_after_s
        return 2.0 * self.every_s if self.every_s is not None else 30 * 3_600.0
