"""What a region's feed does, and when the mouth of a crusher counts as blocked."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.base import Delay, Id, Positive, PositiveSeconds, Strict, Unit


class FeedConfig(Strict):
    """Whether the feed runs, stands or is empty, judged by the pictures of the region."""

    enabled: bool = True
    """Whether it is looked at."""
    rate_hz: Annotated[float, Field(ge=1.0, le=20.0)] = 5.0
    """How often the pictures are compared."""
    stopped_below_mm_s: Positive | None = None
    """On a calibrated belt: slower than this it stands. Left out: a tenth of the calibration's `speed_m_s`, or 30."""
    stopped_below: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    """Without a calibration: slower than this share of the region's longer side a second it stands."""
    bare_below: Annotated[float, Field(gt=0.0, le=1.0)] = 0.03
    """Where the pictures have less contrast than this, as a share of their brightness, the belt is bare."""
    empty_below: Unit = 0.10
    """With less than this share of the belt covered it is empty, once three times `filled_above` were seen to move;
    unknown before, because fines that no camera resolves look like a bare belt."""
    filled_above: Unit = 0.15
    """With more than this it is no longer."""
    delay_s: Delay = 0.2
    """How long another state must be seen without a break."""
    unknown_after_s: PositiveSeconds = 5.0
    """After so long without anything that tells the state it is unknown. Keep it above the distance of key frames: of
    what stands a coder may send nothing between them."""
    sizes_over_s: PositiveSeconds = 900.0
    """Visible sizes are a trend over this time: what is as old counts 1 / e."""
    sizes_from: Annotated[int, Field(ge=1)] = 100
    """They are told from so many measurements of stones on."""
    signal_tolerance: Unit = 0.25
    """By so large a share the speed that is seen may differ from the plant's signal."""
    signal_for_s: PositiveSeconds = 10.0
    """The system alarm says so when the plant's signal has not agreed with what is seen for so long."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.filled_above < self.empty_below:
            raise ValueError(
                f"filled_above ({self.filled_above:g}) must not be smaller than empty_below ({self.empty_below:g})"
            )
        return self


class MouthConfig(Strict):
    """A crusher's mouth or a chute, and when material stands in it; of regions with `watch: mouth`."""

    belt: Id | None = None
    """The ROI of the same camera that shows the belt before it: time counts only while its feed runs, and lumps that
    were followed into the mouth are waited for. Left out: by the plant's signal; without one as if the feed ran."""
    lumps: bool = True
    """Whether a lump that was followed from `belt` into the mouth and stands there blocks it, whatever its share."""
    blocked_above: Annotated[float, Field(gt=0.0, le=1.0)] = 0.25
    """With material standing in more than this share of the mouth it is blocked, once `alarm.blocked.on_delay_s` is
    over."""
    free_below: Unit = 0.12
    """With less than this share it is no longer."""
    learn_s: PositiveSeconds = 10.0
    """How long the mouth must be seen to swallow before it is known; until then the ROI is BLIND, `starting`."""
    working_size_px: Annotated[int, Field(ge=48, le=1920)] = 320
    """Longer side of the working picture."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.free_below < self.blocked_above:
            raise ValueError(
                f"free_below ({self.free_below:g}) must be smaller than blocked_above ({self.blocked_above:g})"
            )
        return self
