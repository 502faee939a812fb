"""The trackers of many objects: the IMM particle filter (paper 2) and JPDA (paper 3).

Both look at what moves before a still camera. Their tracks count for the alarm when they are
confirmed and as large as `size_h`, or as the objects that training saw; the others are listed as well.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.base import NotNegative, Positive, PositiveSeconds, Probability, Strict, Unit
from lumpwatch.service.config.jdt import HistogramConfig, JdtConfig
from lumpwatch.service.config.motion import DetectorBase, MotionConfig, MotionEntry, check_names

Zone = Annotated[tuple[tuple[Unit, Unit], ...], Field(min_length=3, max_length=64)]
"""Corners relative to the ROI's bounding box."""


class MixtureConfig(Strict):
    """OpenCV's mixture of Gaussians for each pixel (MOG2), without its shadows."""

    kind: Literal["mixture"] = "mixture"
    """The fastest."""
    memory_s: PositiveSeconds = 60.0
    """Over which the background is learned, at 15 frames a second."""
    threshold: Positive = 16.0
    """Squared Mahalanobis distance from which a pixel is no longer background."""


class StatisticalConfig(Strict):
    """Tables of colour, gradient and colour co-occurrence for each pixel (Li et al., paper 3)."""

    kind: Literal["statistical"] = "statistical"
    """Knows waving and flickering places, and takes lasting changes into the background at once."""
    learning_rate: Annotated[float, Field(gt=0.0, le=0.5)] = 0.005
    """Weight of one frame."""
    initial_frames: int = Field(default=30, ge=0, le=100_000)
    """Frames at the start that are taken for background."""
    once_off_share: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.85
    """Share of the foreground above which it turns into background."""
    darkest_shadow: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Share of the light that a shadow leaves at least, for example 0.4: what is darker by less, in the colour of the
    ground, is no foreground. 1: shadows are foreground, for a dark object on ground of its own hue looks the same."""


ForegroundConfig = Annotated[MixtureConfig | StatisticalConfig, Field(discriminator="kind")]


class TrackerBase(DetectorBase):
    """What both trackers have."""

    size_h: tuple[Positive, Positive] = (0.02, 1.5)
    """Smallest and largest object that counts for the alarm, in ROI heights, where no size has been learned; the
    default takes in nearly everything."""
    foreground: ForegroundConfig | None = None
    """How moving things are separated from the background; left out: as `train` chose, or statistical."""
    least_area_share: Annotated[float, Field(gt=0.0, le=0.5)] = 0.001
    """Smallest moving region that is considered, as a share of the working picture."""

    @property
    def background(self) -> MixtureConfig | StatisticalConfig:
        """The background model in use."""
        return self.foreground or StatisticalConfig()

    @property
    def needs_colour(self) -> bool:
        """Trackers look at colour."""
        return True


def _learning(config: TrackerBase, models: tuple[MotionConfig, ...]) -> JdtConfig:
    """A tracker takes sizes by row, motion and flow from what a JDT filter of the same models learns."""
    return JdtConfig(
        models=models,
        likelihood=HistogramConfig(),
        working_size_px=config.working_size_px,
        size_h=config.size_h,
        seed=config.seed,
    )


IMM_MODELS = (
    MotionConfig(name="position", kind="constant_position"),
    MotionConfig(name="velocity", kind="constant_velocity"),
    MotionConfig(name="acceleration", kind="free_acceleration"),
)


class ImmPfConfig(TrackerBase):
    """One particle filter a target with several motion models and no transition prior (Madrigal, Hayet)."""

    kind: Literal["imm_pf"]
    """The IMM particle filter."""
    models: Annotated[tuple[MotionEntry, ...], Field(min_length=1, max_length=8)] = IMM_MODELS
    """The motion models; a kind alone, or a mapping with name, kind and parameters."""
    particles: int = Field(default=200, ge=20, le=100_000)
    """Particles of each target."""
    all_every: int = Field(default=4, ge=0, le=1000)
    """Frames between resamplings over all particles (rho); 0 for never."""
    model_every: int = Field(default=5, ge=0, le=1000)
    """Frames between resamplings within the models (phi); 0 for never."""
    least_model_share: Annotated[float, Field(ge=0.0, le=0.5)] = 0.1
    """Share of the particles that each motion model keeps (gamma)."""
    hidden_s: PositiveSeconds = 4.0
    """How long a target may stay hidden or weak before it ends."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_names(self.models)
        if self.least_model_share * len(self.models) > 1.0:
            raise ValueError(f"least_model_share is too large for {len(self.models)} models")
        return self

    @property
    def learning(self) -> JdtConfig:
        """What `train` learns for."""
        return _learning(self, self.models)

    @property
    def summary(self) -> str:
        """In a few words."""
        return f"imm_pf ({', '.join(model.name for model in self.models)})"


class OneWayConfig(Strict):
    """The direction that is right; a track against it is flagged."""

    direction: tuple[float, float]
    """Along x (to the right) and y (downwards)."""
    distance_h: Positive = 0.1
    """How far an object moves against the direction before it is flagged, ROI heights."""
    for_s: NotNegative = 0.3
    """How long that takes at least."""

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.direction == (0.0, 0.0):
            raise ValueError("direction must have a length")
        return self


class JpdaConfig(TrackerBase):
    """Joint probabilistic data association of moving regions with targets (paper 3)."""

    kind: Literal["jpda"]
    """The joint probabilistic data association filter."""
    model: MotionEntry = MotionConfig(name="velocity", kind="constant_velocity")
    """How targets move; any kind but motion_prior."""
    detection: Annotated[float, Field(gt=0.0, le=1.0)] = 0.9
    """Probability that an object is found in a frame."""
    clutter: Positive = 0.5
    """False regions expected in a frame."""
    association: Literal["jpda_star", "jpda"] = "jpda_star"
    """How regions are given to targets: jpda_star keeps close targets apart, jpda is the sum over all pairings."""
    gate_sigma: Positive = 4.0
    """Radius of the validation gate in standard deviations."""
    measurement_noise_h: Positive = 0.01
    """Standard deviation of a region's centre, ROI heights."""
    colour_weight: Probability = 0.3
    """Exponent of the colour likelihood; space has the rest."""
    confirm_s: NotNegative = 0.1
    """How long a target must have been seen until it counts."""
    missed_s: NotNegative = 0.3
    """A target that was missed for longer ends."""
    entries: tuple[Zone, ...] = ()
    """Where targets start; empty: anywhere."""
    exits: tuple[Zone, ...] = ()
    """Where a target ends when it is missed once."""
    one_way: OneWayConfig | None = None
    """The right direction, where there is one."""

    @model_validator(mode="after")
    def _affine(self) -> Self:
        if self.model.kind == "motion_prior" or self.model.kind.startswith("bounce"):
            raise ValueError(f"model: a Kalman filter cannot move by {self.model.kind}")
        return self

    @property
    def models(self) -> tuple[MotionConfig, ...]:
        """The one motion model."""
        return (self.model,)

    @property
    def learning(self) -> JdtConfig:
        """What `train` learns for."""
        return _learning(self, self.models)

    @property
    def summary(self) -> str:
        """In a few words."""
        return f"jpda ({self.model.name}; {self.background.kind})"
