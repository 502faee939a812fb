"""The motion models of a detector, and what all kinds of detectors have in common.

Lengths of the motion models are in ROI heights (`_h`): they keep their meaning when the camera's
resolution or the working size changes. A standard deviation with `_noise_` in its name is what
gathers in one second.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from lumpwatch.service.config.base import Id, Positive, Strict

MOTION_KINDS = (
    "constant_position",
    "random_walk",
    "constant_velocity",
    "constant_acceleration",
    "bounce_x",
    "bounce_y",
    "bounce",
    "free_acceleration",
    "motion_prior",
)
_OWN_KIND = r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$"


def _known(kind: str) -> str:
    if kind not in MOTION_KINDS and not re.match(_OWN_KIND, kind):
        raise ValueError(f"'{kind}' is neither package.module:Class nor one of {', '.join(MOTION_KINDS)}")
    return kind


MotionKind = Annotated[
    str,
    AfterValidator(_known),
    WithJsonSchema({"anyOf": [{"enum": list(MOTION_KINDS)}, {"type": "string", "pattern": _OWN_KIND}]}),
]


class MotionConfig(Strict):
    """One motion model of the filter."""

    name: Id
    """Name by which states, metrics and labels speak of the model."""
    kind: MotionKind
    """The law of motion; or `package.module:Class` for one of your own, see docs/models.md."""
    parameters: dict[str, float] = Field(default_factory=dict)
    """What the constructor of your own model takes beside `name` and `height`."""
    acceleration_h_s2: tuple[float, float] | None = None
    """Rate (x, y) of constant_acceleration, ROI heights per second squared; left out: learned or default."""
    position_noise_h: Positive | None = None
    """Spread of the position that gathers in one second (constant_position, random_walk)."""
    velocity_noise_h_s: Positive | None = None
    """Spread of the velocity that gathers in one second (all models with a velocity)."""
    acceleration_noise_h_s2: Positive | None = None
    """Spread of the acceleration that gathers in one second (free_acceleration)."""

    @property
    def custom(self) -> bool:
        """Whether the model is the user's own."""
        return ":" in self.kind

    @model_validator(mode="after")
    def _fits_kind(self) -> Self:
        still = self.kind in ("constant_position", "random_walk")
        if self.acceleration_h_s2 is not None and self.kind != "constant_acceleration":
            raise ValueError(f"acceleration_h_s2 belongs to constant_acceleration, not to {self.kind}")
        if self.parameters and not self.custom:
            raise ValueError(f"parameters belong to a model of your own, not to {self.kind}")
        if self.acceleration_noise_h_s2 is not None and self.kind != "free_acceleration":
            raise ValueError(f"acceleration_noise_h_s2 belongs to free_acceleration, not to {self.kind}")
        if self.velocity_noise_h_s is not None and still:
            raise ValueError(f"velocity_noise_h_s does not belong to {self.kind}; use position_noise_h")
        if self.position_noise_h is not None and not still:
            raise ValueError(f"position_noise_h does not belong to {self.kind}; use velocity_noise_h_s")
        return self


def _entry(value: Any) -> Any:
    """A kind alone stands for a model of that kind and name; a mapping without a name takes its kind."""
    if isinstance(value, str):
        return {"name": value, "kind": value}
    if isinstance(value, dict) and "name" not in value and isinstance(value.get("kind"), str):
        return {"name": value["kind"], **value}
    return value


MotionEntry = Annotated[
    MotionConfig, BeforeValidator(_entry, json_schema_input_type=MotionKind | MotionConfig)
]


class DetectorBase(Strict):
    """What every kind of detector has."""

    working_size_px: int = Field(default=320, ge=48, le=1920)
    """The ROI is scaled once so that its longer side has this many pixels (never enlarged). Left out for a tracker: as
    `train` chose, or 320."""
    size_h: tuple[Positive, Positive] = (0.12, 0.45)
    """Smallest and largest object, in ROI heights, where no size has been learned and no limit is known. Where the
    polygon narrows, as a belt does far away, so do they: as said they hold at its wider rows."""
    seed: int = Field(default=1, ge=0)
    """Seed of the detector's random generator."""

    @model_validator(mode="after")
    def _sizes(self) -> Self:
        if self.size_h[0] >= self.size_h[1]:
            raise ValueError("size_h must be [smallest, largest]")
        return self


def check_names(models: tuple[MotionConfig, ...]) -> None:
    """Raises ValueError where two motion models have the same name."""
    names = [model.name for model in models]
    if twice := {n for n in names if names.count(n) > 1}:
        raise ValueError(f"models: name '{min(twice)}' is given more than once; give each model a name")
