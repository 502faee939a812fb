"""What a simulated feed shows: one frozen model, also readable from a `sim:feed?…` query."""

from __future__ import annotations

from typing import Any, Self
from urllib.parse import parse_qsl

from pydantic import Field, ValidationError, model_validator

from service.config.base import NotNegative, Positive, PositiveSeconds, Strict, Unit
from service.errors import ConfigError


class FeedSpec(Strict):
    """A crusher's feeder seen by a fixed camera. The same spec gives the same bytes."""

    seed: int = Field(default=0, ge=0)
    """Seed of everything random."""
    width: int = Field(default=640, ge=160, le=3840, multiple_of=2)
    """Width of the picture in pixels."""
    height: int = Field(default=480, ge=120, le=2160, multiple_of=2)
    """Height of the picture in pixels."""
    fps: float = Field(default=15.0, ge=0.5, le=240.0)
    """Frames a second; the motion in seconds does not depend on it."""
    gray: bool = True
    """Gray pictures; false: BGR with a brown tint."""
    seconds: PositiveSeconds | None = None
    """Length of the feed as a source; none: endless."""

    belt_width_mm: Positive = 2400.0
    """Width of the belt between the side walls."""
    belt_length_mm: Positive = 6000.0
    """Length of the belt from the top of the picture to the lip; at least twice the width."""
    belt_speed_mm_s: Positive = 600.0
    """Speed of the belt while it runs."""
    gravity_mm_s2: Positive = 9810.0
    """Acceleration past the lip."""
    stop_every_s: NotNegative = 0.0
    """Mean time between stops of the belt; 0: it never stops."""
    stop_duration_s: float = Field(default=4.0, ge=0.5, le=3600.0)
    """How long a stop lasts, ramps included by half."""

    limit_mm: Positive = 600.0
    """Longest diameter that the crusher takes; lumps are larger."""
    smallest_lump: float = Field(default=1.2, gt=0.7, le=4.0)
    """Longest diameter of the smallest lump in units of the limit."""
    largest_lump: float = Field(default=2.0, gt=0.7, le=4.0)
    """Longest diameter of the largest lump in units of the limit."""
    lumps_per_minute: float = Field(default=8.0, ge=0.0, le=60.0)
    """Mean number of lumps a minute of a running belt."""
    lump_spacing_s: NotNegative = 2.5
    """Least time between two lumps; shorter where the rate leaves no room for it."""
    medium_rocks_per_minute: float = Field(default=70.0, ge=0.0, le=300.0)
    """Mean number of rocks of 0.3 to 0.7 of the limit a minute; they are never labelled."""

    dust: Unit = 0.25
    """Strength of the dust clouds."""
    light_drift: Unit = 0.08
    """Amplitude of the slow change of light, as a share."""
    flicker: Unit = 0.015
    """Amplitude of the lamps' flicker, as a share."""
    light_step: float = Field(default=1.0, ge=0.05, le=4.0)
    """Factor on the light from `light_step_at_s` on."""
    light_step_at_s: NotNegative | None = None
    """When the light steps; none: never."""
    shake_px: float = Field(default=0.5, ge=0.0, le=10.0)
    """Amplitude of the camera's vibration in pixels."""
    noise: float = Field(default=2.5, ge=0.0, le=40.0)
    """Standard deviation of the sensor's noise in grey levels."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.width < 1.25 * self.height:
            raise ValueError(f"width ({self.width}) must be at least 1.25 times the height ({self.height})")
        if self.belt_length_mm < 2 * self.belt_width_mm:
            raise ValueError("belt_length_mm must be at least twice belt_width_mm")
        if self.largest_lump < self.smallest_lump:
            raise ValueError("largest_lump must not be smaller than smallest_lump")
        if self.largest_lump * self.limit_mm > self.belt_width_mm:
            raise ValueError("largest_lump times limit_mm must not exceed belt_width_mm")
        return self

    @classmethod
    def from_query(cls, query: str, **overrides: object) -> Self:
        """The spec that `lumps_per_minute=8&dust=0.5` states; `overrides` go before the query.

        Raises ConfigError, one line that names the key and what was expected.
        """
        values: dict[str, Any] = {}
        try:
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
        except ValueError as error:
            raise ConfigError(f"sim:feed: expected key=value&key=value, found '{query}'") from error
        for key, value in pairs:
            if key in values:
                raise ConfigError(f"sim:feed: {key}: given more than once")
            values[key] = value
        try:
            return cls.model_validate({**values, **overrides})
        except ValidationError as error:
            raise ConfigError(f"sim:feed: {_problem(error)}") from error


def _problem(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_context=False)[0]
    message = str(first["msg"])
    if not first["loc"]:
        return message.removeprefix("Value error, ")
    key = first["loc"][0]
    if first["type"] == "extra_forbidden":
        return f"{key}: unknown key, expected one of {', '.join(FeedSpec.model_fields)}"
    return f"{key}: {message[:1].lower()}{message[1:]}, found '{first['input']}'"
