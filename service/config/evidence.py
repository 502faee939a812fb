"""What is kept of an alarm to look at, and to replay, afterwards."""

from __future__ import annotations

from typing import Annotated, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import Field, field_validator, model_validator

from lumpwatch.service.config.base import Strict

_Megabytes = Annotated[int, Field(ge=1, le=100_000_000)]
Days = Annotated[float, Field(gt=0.0, le=36_500.0)]


class EvidenceConfig(Strict):
    """Clips of the frames around an alarm, kept under `store.path/evidence`."""

    enabled: bool = True
    """Whether evidence is kept at all."""
    classes: tuple[Literal["lump", "blind", "blocked"], ...] = ("lump", "blocked")
    """Classes of alarm whose raising is recorded."""
    pre_roll_s: Annotated[float, Field(ge=0.0, le=600.0)] = 10.0
    """How much is kept from before the alarm; up to a second more, and less where memory does not suffice."""
    post_roll_s: Annotated[float, Field(ge=0.0, le=600.0)] = 5.0
    """How much is kept from after the alarm."""
    memory_mb: _Megabytes = 128
    """Memory for the pre-roll of one camera, MiB; clips being recorded or written may take twice as much."""
    max_mb: _Megabytes = 10_000
    """Disk space for all evidence, MiB, as far as `max_share` leaves it; the oldest goes first."""
    max_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.6
    """Share of the store's disk that evidence takes at most: event log and priors need the rest."""
    keep_days: Days = 90.0
    """How long evidence is kept."""
    keep_judged_days: Days | None = None
    """How long evidence with a verdict is kept; left out: as any other. It also gives way to others last."""
    least_free_mb: Annotated[int, Field(ge=0, le=100_000_000)] = 256
    """Nothing is written to a disk with less space left than this, MiB: the event log needs it more."""
    encode_niceness: Annotated[int, Field(ge=0, le=19)] = 10
    """How far writing stands back behind the filter for processor time."""


class ShiftsConfig(Strict):
    """The shifts that `lumpwatch report` knows by name."""

    time_zone: str = "UTC"
    """Name of the time zone, such as `Australia/Perth`."""
    starts: dict[str, Annotated[str, Field(pattern=r"^([01]\d|2[0-3]):[0-5]\d$")]] = Field(
        default={"day": "06:00", "night": "18:00"}, min_length=1, max_length=24
    )
    """When each shift begins, local time; it lasts until the next one begins."""

    @field_validator("time_zone")
    @classmethod
    def _known(cls, value: str) -> str:
        try:
            ZoneInfo(value)
        except (ValueError, OSError) as error:  # ZoneInfoNotFoundError is a KeyError
            raise ValueError(f"time zone '{value}' is not known") from error
        except KeyError:
            raise ValueError(f"time zone '{value}' is not known on this machine") from None
        return value

    @model_validator(mode="after")
    def _different(self) -> Self:
        if len(set(self.starts.values())) < len(self.starts):
            raise ValueError("two shifts begin at the same time")
        if reserved := {"last", "current"} & set(self.starts):
            raise ValueError(f"a shift cannot be called '{min(reserved)}'")
        return self
