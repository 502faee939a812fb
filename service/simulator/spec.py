"""What a simulated feed shows: one frozen model, also readable from a `sim:feed?…` query."""

from __future__ import annotations

from typing import Any, Literal, Self
from urllib.parse import parse_qsl

from pydantic import Field, ValidationError, model_validator

from lumpwatch.service.config import NotNegative, Positive, PositiveSeconds, Strict, Unit
from lumpwatch.service.errors import ConfigError

# A belt of style b is narrower and shorter where the spec does not say.
_STYLE_B = {"belt_width_mm": 1800.0, "belt_length_mm": 3600.0}


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
    """Gray pictures; false: BGR, brown in style a, cool in style b."""
    seconds: PositiveSeconds | None = None
    """Length of the feed as a source; none: endless."""
    style: Literal["a", "b"] = "a"
    """Look of the place: b has another camera, belt (1800 x 3600 mm unless given), ore, rocks and light."""
    h264_crf: int | None = Field(default=None, ge=0, le=51)
    """Pictures come through H.264 of this quality (35: blocky, 45: ruined); none: uncompressed."""

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
    speed_change: float = Field(default=0.0, ge=0.0, le=0.8)
    """The belt's speed changes at random within 1 minus and 1 plus this share of `belt_speed_mm_s`."""
    speed_change_every_s: float = Field(default=8.0, ge=2.0, le=3600.0)
    """Running time between two changes of the speed."""
    empty_every_s: NotNegative = 0.0
    """Mean running time of the belt between two stretches on which nothing lies; 0: there are none."""
    empty_duration_s: float = Field(default=12.0, ge=1.0, le=3600.0)
    """How long such a stretch is, as the time that it takes to pass."""

    mouth_level: Unit = 0.0
    """How high material usually lies in the crusher's mouth, between lip and rim, as a share of that; 0: what falls in
    goes through at once."""
    mouth_fill_s: float = Field(default=12.0, ge=1.0, le=600.0)
    """How long the full feed takes to fill the mouth when nothing goes through."""
    hesitate_every_s: NotNegative = 0.0
    """Mean time of a running feed between two moments in which the mouth holds back, as in normal crushing; 0: none."""
    hesitate_longest_s: float = Field(default=4.0, gt=0.0, le=60.0)
    """Such a moment lasts a fifth of this at least, and this at most."""
    bridge_every_s: NotNegative = 0.0
    """Mean time of a running feed between two bridges in the mouth; 0: there are none."""
    bridge_duration_s: float = Field(default=30.0, ge=1.0, le=86_400.0)
    """How long a bridge holds; then it breaks, and goes through."""
    bridge_width: float = Field(default=1.0, ge=0.1, le=1.0)
    """Share of the mouth's width that bridges; the rest goes on swallowing."""
    stuck_share: Unit = 0.0
    """Share of the lumps that lodge in the mouth before they go through."""
    stuck_duration_s: float = Field(default=30.0, ge=1.0, le=86_400.0)
    """How long they stay there."""

    limit_mm: Positive = 600.0
    """Longest diameter that the crusher takes; lumps are larger."""
    smallest_lump: float = Field(default=1.2, ge=0.7, le=4.0)
    """Longest diameter of the smallest lump in units of the limit."""
    largest_lump: float = Field(default=2.0, ge=0.7, le=4.0)
    """Longest diameter of the largest lump in units of the limit."""
    lumps_per_minute: float = Field(default=8.0, ge=0.0, le=60.0)
    """Mean number of lumps a minute of a running belt."""
    lump_spacing_s: NotNegative = 2.5
    """Least time between two lumps; shorter where the rate leaves no room for it."""
    medium_rocks_per_minute: float = Field(default=70.0, ge=0.0, le=300.0)
    """Mean number of rocks of 0.3 to 0.7 of the limit a minute; they are never labelled."""
    near_limit_rocks_per_minute: float = Field(default=0.0, ge=0.0, le=60.0)
    """Mean number of rocks of 0.7 to 1.0 of the limit a minute that look like lumps; never labelled."""
    lump_contrast: Unit = 1.0
    """Contrast of lumps and near-limit rocks; 0: brightness and texture of the ore, no shadow."""
    frozen_share: Unit = 0.0
    """Share of the lumps that are frozen agglomerates: rough, dark, partly covered with fines."""
    smooth_share: Unit = 0.0
    """Share of the lumps that are smooth and round."""
    slab_share: Unit = 0.0
    """Share of the lumps that are flat slabs."""
    buried_share: Unit = 0.0
    """Share of the lumps of which only the upper 45 to 75 % of the height shows."""
    touching_share: float = Field(default=0.0, ge=0.0, le=0.8)
    """Share of the lumps that touch the one before."""
    cluster_share: Unit = 0.0
    """Share of the lumps that lie in a cluster of medium rocks."""
    roll_share: Unit = 0.0
    """Share of the lumps that roll, forward or backward; those that are buried or touch do not."""
    roll_slip: float = Field(default=0.12, gt=0.0, le=0.5)
    """How much faster or slower than the belt rolling lumps are, at most, as a share of its speed."""

    dust: Unit = 0.25
    """Strength of the dust clouds."""
    dust_burst: float = Field(default=0.0, ge=0.0, le=4.0)
    """Strength that a burst adds to the dust at its peak; it rises in half a second, settles in five."""
    dust_burst_every_s: float = Field(default=15.0, ge=1.0, le=3600.0)
    """Mean time between bursts of dust."""
    steam: Unit = 0.0
    """Strength of white clouds that rise fast."""
    rain: Unit = 0.0
    """Strength of the streaks of rain."""
    snow: Unit = 0.0
    """Density of the snow."""
    lens_drops: int = Field(default=0, ge=0, le=40)
    """Number of drops on the lens, where it is wet."""
    night: Unit = 0.0
    """Infra-red look: little light, a hot spot, dark corners, coarse noise of 16 grey levels, no colour."""
    sun_patches: Unit = 0.0
    """Strength of bright patches that wander slowly; 1 doubles the light."""
    shadow_edges: Unit = 0.0
    """Darkness of the shadows that sweep across the belt."""
    shadow_every_s: float = Field(default=12.0, ge=1.0, le=3600.0)
    """Mean time between such shadows; each passes in four seconds."""
    light_drift: Unit = 0.08
    """Amplitude of the slow change of light, as a share."""
    flicker: Unit = 0.015
    """Amplitude of the lamps' flicker, as a share."""
    light_step: float = Field(default=1.0, ge=0.05, le=4.0)
    """Factor on the light from `light_step_at_s` on."""
    light_step_at_s: NotNegative | None = None
    """When the light steps; none: never."""
    exposure_jump: float = Field(default=1.0, ge=1.0, le=5.0)
    """Factor by which the automatic exposure jumps, up or down; 1: never."""
    exposure_every_s: float = Field(default=10.0, ge=1.0, le=3600.0)
    """Mean time between such jumps."""
    exposure_recovery_s: float = Field(default=2.0, gt=0.0, le=60.0)
    """Time constant with which the exposure recovers."""
    shake_px: float = Field(default=0.5, ge=0.0, le=20.0)
    """Amplitude of the camera's vibration in pixels."""
    camera_shift_x_px: float = Field(default=0.0, ge=-40.0, le=40.0)
    """How far the picture moves to the right when the camera is knocked, pixels."""
    camera_shift_y_px: float = Field(default=0.0, ge=-40.0, le=40.0)
    """How far the picture moves down when the camera is knocked, pixels."""
    camera_shift_at_s: NotNegative | None = None
    """When the camera is knocked, for good; none: never. Outline and homography stay those before."""
    noise: float = Field(default=2.5, ge=0.0, le=40.0)
    """Standard deviation of the sensor's noise in grey levels."""

    @model_validator(mode="before")
    @classmethod
    def _belt_of_the_style(cls, given: Any) -> Any:
        return {**_STYLE_B, **given} if isinstance(given, dict) and given.get("style") == "b" else given

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
        if self.frozen_share + self.smooth_share + self.slab_share > 1 + 1e-9:
            raise ValueError("frozen_share, smooth_share and slab_share must not exceed 1 together")
        return self

    @property
    def has_mouth(self) -> bool:
        """Whether the mouth is anything to watch."""
        return self.mouth_level > 0 or self.bridge_every_s > 0 or self.stuck_share > 0

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
