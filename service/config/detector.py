"""How a ROI's filter works: motion models, switching, likelihood and existence.

Lengths of the motion models are in ROI heights (`_h`): they keep their meaning when the camera's
resolution or the working size changes. A standard deviation with `_noise_` in its name is what
gathers in one second.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from service.config.base import Id, Positive, PositiveSeconds, Probability, Strict

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
LUMP_MODELS = (
    MotionConfig(name="belt", kind="constant_acceleration"),
    MotionConfig(name="fall", kind="constant_acceleration"),
)


class LumpConfig(Strict):
    """Likelihood of a lump among ore: texture, edges and brightness against the surroundings."""

    kind: Literal["lump"] = "lump"
    """A logistic score on a few image features; `train` fits it."""
    evidence: Positive = 0.25
    """Share of a frame's log likelihood ratio that counts: neighbouring frames repeat each other."""
    bound: Positive = 3.0
    """Largest log likelihood ratio of one frame, so that a single frame never decides."""


class HistogramConfig(Strict):
    """Likelihood by the distance of a box's histogram to a learned reference."""

    kind: Literal["histogram"] = "histogram"
    """Bhattacharyya distance to the reference histogram that `train` learns."""
    channel: Literal["luma", "colour"] = "luma"
    """16 bins of brightness, or 16 bins of hue and brightness."""
    evidence: Positive = 0.5
    """Share of a frame's log likelihood ratio that counts."""
    bound: Positive = 6.0
    """Largest log likelihood ratio of one frame."""


LikelihoodConfig = Annotated[LumpConfig | HistogramConfig, Field(discriminator="kind")]


class ExistenceConfig(Strict):
    """The two-state Markov chain of existence (Eq. 5), as rates, so that it fits any frame rate."""

    birth_rate_hz: Positive = 0.05
    """Objects that appear in an empty ROI, per second."""
    mean_life_s: PositiveSeconds = 8.0
    """How long an object stays in the ROI on average."""
    births: Literal["uniform", "learned"] = "uniform"
    """Where new objects appear: anywhere in the polygon, or mostly where labelled ones did."""
    born_share: Probability = 0.3
    """Share of the particles that search for a new object at each step."""


class JdtConfig(Strict):
    """Joint detection and tracking with several motion models (Wang, Ben Salah, Zhang)."""

    kind: Literal["jdt"] = "jdt"
    """The particle filter over state, motion model and existence."""
    particles: int = Field(default=2000, ge=50, le=1_000_000)
    """Number of particles."""
    models: Annotated[tuple[MotionEntry, ...], Field(min_length=1, max_length=16)] = LUMP_MODELS
    """The motion models; a kind alone, or a mapping with name, kind and parameters."""
    switching: Literal["adaptive", "fixed"] = "adaptive"
    """Whether the next model depends on where the object is (Eq. 12) or on the last model only (Eq. 10)."""
    switch_on: Literal["row", "column", "position", "vertical_velocity"] = "row"
    """What of the state the learned densities of adaptive switching look at."""
    bandwidth: Literal["scott", "silverman", "likelihood"] = "scott"
    """How `train` chooses the width of the densities' kernels: a rule, or leave-one-out likelihood."""
    least_model_share: float = Field(default=0.0, ge=0.0, le=0.5)
    """Share of the particles that every motion model gets at least, so that a rare one does not die out."""
    order: Literal["model_first", "state_first"] = "model_first"
    """Draw the new model and move by it, or move by the last model as Eq. 9 has it literally."""
    form: Literal["marginal", "sampled"] = "marginal"
    """Existence from the weights (Rutten et al.), or as share of particles (Fig. 6)."""
    objects: int = Field(default=3, ge=1, le=8)
    """Largest number of objects that are followed at once (form sampled: 1)."""
    likelihood: LikelihoodConfig = LumpConfig()
    """How the picture speaks for or against an object at a place."""
    existence: ExistenceConfig = ExistenceConfig()
    """Birth and death."""
    working_size_px: int = Field(default=320, ge=48, le=1920)
    """The ROI is scaled once so that its longer side has this many pixels (never enlarged)."""
    size_h: tuple[Positive, Positive] = (0.12, 0.45)
    """Smallest and largest object, in ROI heights, where no size has been learned."""
    seed: int = Field(default=1, ge=0)
    """Seed of the filter's random generator."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [model.name for model in self.models]
        if twice := {n for n in names if names.count(n) > 1}:
            raise ValueError(f"models: name '{min(twice)}' is given more than once; give each model a name")
        if self.form == "sampled" and self.objects > 1 and "objects" in self.model_fields_set:
            raise ValueError("form sampled follows one object: objects must be 1")
        if self.least_model_share * len(self.models) > 1.0:
            raise ValueError(f"least_model_share is too large for {len(self.models)} models")
        if self.size_h[0] >= self.size_h[1]:
            raise ValueError("size_h must be [smallest, largest]")
        return self

    @property
    def several(self) -> bool:
        """Whether more than one object is followed."""
        return self.objects > 1 and self.form == "marginal"

    @property
    def needs_colour(self) -> bool:
        """Whether the likelihood looks at colour."""
        return isinstance(self.likelihood, HistogramConfig) and self.likelihood.channel == "colour"
