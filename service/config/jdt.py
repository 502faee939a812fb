"""The JDT filter of a ROI: motion models, switching, likelihood and existence (paper 1)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from lumpwatch.service.config.base import Positive, PositiveSeconds, Probability, Strict, kind_or
from lumpwatch.service.config.motion import DetectorBase, MotionConfig, MotionEntry, check_names

LUMP_MODELS = (
    MotionConfig(name="belt", kind="constant_acceleration"),
    MotionConfig(name="fall", kind="constant_acceleration"),
)


class LumpConfig(Strict):
    """Likelihood of a lump among ore: texture, edges and brightness against the surroundings."""

    kind: Literal["lump"] = "lump"
    """A logistic score on a few image features; `train` fits it."""
    evidence: Positive | None = None
    """Share of a frame's log likelihood ratio that counts: neighbouring frames repeat each other. Left out: what
    `train` learned of that, or its default."""
    margin: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None
    """How far a box's log likelihood ratio must lie above zero before it speaks for a lump. More: fewer false alarms,
    and lumps that hardly show are missed. Left out: what `train` chose for this region, and 2 where it never was
    trained."""
    bound: Positive = 3.0
    """Largest log likelihood ratio of one frame, so that a single frame never decides."""


class HistogramConfig(Strict):
    """Likelihood by the distance of a box's histogram to a learned reference."""

    kind: Literal["histogram"] = "histogram"
    """Bhattacharyya distance to the reference histogram that `train` learns."""
    channel: Literal["luma", "colour"] = "luma"
    """16 bins of brightness, or 16 bins of hue and brightness."""
    evidence: Positive | None = None
    """Share of a frame's log likelihood ratio that counts. Left out: what `train` learned of that."""
    bound: Positive = 6.0
    """Largest log likelihood ratio of one frame."""


Side = Annotated[int, Field(ge=8, le=4096)]


class NetworkConfig(Strict):
    """Likelihood from a network of your own: an ONNX file that gives a map of logits."""

    kind: Literal["network"] = "network"
    """The mean of the network's map in a box against the ring around it and a threshold."""
    model: Path
    """The ONNX file; a relative path counts from the configuration's folder."""
    input_px: tuple[Side, Side] | None = None
    """Width and height of the picture that the network takes; left out: the ROI's working picture as it is."""
    channels: Literal[1, 3] = 1
    """Channels that it takes; with 3 each is the same grey picture."""
    scale: Positive = 1 / 255
    """Grey levels (0 to 255) are multiplied by this."""
    threshold: float = 0.0
    """Mean logit of a box from which it speaks for a lump."""
    evidence: Positive = 0.25
    """Share of a frame's log likelihood ratio that counts: neighbouring frames repeat each other."""
    bound: Positive = 3.0
    """Largest log likelihood ratio of one frame, so that a single frame never decides."""

    @field_validator("model")
    @classmethod
    def _from_folder(cls, model: Path, info: ValidationInfo) -> Path:
        folder = (info.context or {}).get("folder")
        return model if folder is None else folder / model


LikelihoodConfig = Annotated[
    Annotated[LumpConfig, Tag("lump")]
    | Annotated[HistogramConfig, Tag("histogram")]
    | Annotated[NetworkConfig, Tag("network")],
    Discriminator(
        kind_or("lump"),
        custom_error_type="likelihood_kind",
        custom_error_message="expected a mapping with kind lump, histogram or network",
    ),
]
"""A mapping without a kind is a `lump`."""


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


class JdtConfig(DetectorBase):
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

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_names(self.models)
        if self.form == "sampled" and self.objects > 1 and "objects" in self.model_fields_set:
            raise ValueError("form sampled follows one object: objects must be 1")
        if self.least_model_share * len(self.models) > 1.0:
            raise ValueError(f"least_model_share is too large for {len(self.models)} models")
        return self

    @property
    def several(self) -> bool:
        """Whether more than one object is followed."""
        return self.objects > 1 and self.form == "marginal"

    @property
    def needs_colour(self) -> bool:
        """Whether the likelihood looks at colour."""
        return isinstance(self.likelihood, HistogramConfig) and self.likelihood.channel == "colour"

    @property
    def learning(self) -> JdtConfig:
        """What `train` learns for: this filter itself."""
        return self

    @property
    def summary(self) -> str:
        """In a few words."""
        return f"jdt ({', '.join(model.name for model in self.models)}; {self.switching})"
