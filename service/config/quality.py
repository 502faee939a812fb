"""When a picture counts as unfit to judge: checks, and how long each must find something."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lumpwatch.service.config.base import Delay, PositiveSeconds, Strict, Unit


class CheckConfig(Strict):
    """One check of the picture, judged by a median over seconds."""

    enabled: bool = True
    """Whether it is made."""
    entry_s: Delay = 2.0
    """How long it must find something without a break before the ROI is BLIND."""
    exit_s: Delay = 2.0
    """How long it must find nothing without a break before the ROI sees again."""


class HiddenConfig(CheckConfig):
    """Whether anything lies between the camera and the belt."""

    standing: bool = True
    """Whether an object that stays in its place while the belt around it moves is none of the belt's: it does not
    count for the lump alarm, and hides the region. Looked for with the likelihood `lump`."""


class MovedConfig(CheckConfig):
    """Whether the camera still looks where it did; needs a reference."""

    entry_s: Delay = 3.0
    """How long it must find something without a break before the ROI is BLIND or follows."""
    window_s: PositiveSeconds = 5.0
    """The shift is a median over this time."""
    every_s: PositiveSeconds = 1.0
    """How often the picture is registered."""
    follow_up_to: Annotated[float, Field(ge=0.0, le=0.1)] = 0.02
    """Shifts up to this share of the picture's width move the ROIs along; larger ones are BLIND. 0: none."""


class ExposureConfig(Strict):
    """A hold-off after the exposure has jumped: the ROI is BLIND, and the lump alarm is not judged."""

    enabled: bool = True
    """Whether it is looked for."""
    factor: Annotated[float, Field(gt=1.0, le=10.0)] = 1.3
    """A jump is a mean grey level that is larger or smaller by this within half a second."""
    hold_s: PositiveSeconds = 1.0
    """How long the hold-off lasts from the last jump on."""


class StarvedConfig(CheckConfig):
    """Whether the filter has particles to think with."""

    entry_s: Delay = 5.0
    """How long it must find something without a break before the ROI is BLIND."""
    least_particles: Annotated[float, Field(ge=1.0, le=1000.0)] = 5.0
    """Effective particles below which the filter counts as starved."""


class OverloadConfig(CheckConfig):
    """Whether decisions are made on enough frames, and in time."""

    entry_s: Delay = 5.0
    """How long it must find something without a break before the ROI is BLIND."""
    exit_s: Delay = 5.0
    """How long it must find nothing without a break before the ROI sees again."""
    longest_age_s: PositiveSeconds = 1.0
    """Frames that are older when they are judged are too late."""
    least_share: Unit = 0.2
    """The least share of the frames that are due (`decide_hz`) that must be judged."""


class QualityConfig(Strict):
    """Whether the picture is fit to judge. What is not makes the ROIs of the camera BLIND.

    A fault is found within `found_within_s`: the time of the median, the check's `entry_s`, and two pictures.
    """

    enabled: bool = True
    """Whether any check is made; without, only a missing, late or failing stream is BLIND."""
    rate_hz: Annotated[float, Field(gt=0.0, le=30.0)] = 5.0
    """How often a picture is measured."""
    window_s: PositiveSeconds = 2.0
    """Measures are medians over this time: one frame decides nothing."""
    frozen: CheckConfig = CheckConfig(entry_s=3.0, exit_s=1.0)
    """The picture does not change. Keep `window_s` plus `entry_s` above the distance of key frames."""
    dark: CheckConfig = CheckConfig(entry_s=1.0)
    """There is too little light."""
    glare: CheckConfig = CheckConfig()
    """Too much of the picture is saturated."""
    blurred: CheckConfig = CheckConfig(entry_s=3.0)
    """Fine structure is gone: out of focus, or dirt on the lens."""
    dusty: CheckConfig = CheckConfig()
    """A bright veil takes structure away over most of the region."""
    hidden: HiddenConfig = HiddenConfig()
    """Too much of the region is featureless or does not look as in the reference, or something stands before it."""
    moved: MovedConfig = MovedConfig()
    """The camera has moved."""
    exposure: ExposureConfig = ExposureConfig()
    """The exposure has jumped."""
    filter: StarvedConfig = StarvedConfig()
    """The filter is starved of particles."""
    overload: OverloadConfig = OverloadConfig()
    """Too few frames are judged, or too late."""

    def found_within_s(self, check: CheckConfig) -> float:
        """The longest time from the beginning of a fault that one of these checks finds until BLIND."""
        if isinstance(check, MovedConfig):
            return check.window_s + check.entry_s + 2.0 * check.every_s
        if isinstance(check, OverloadConfig):
            return 2.0 * check.entry_s + 2.0 / self.rate_hz  # its window is as long as its entry
        return self.window_s + check.entry_s + 2.0 / self.rate_hz

    @property
    def follows(self) -> float:
        """Largest shift that is followed, as a share of the width; 0: none is."""
        return self.moved.follow_up_to if self.enabled and self.moved.enabled else 0.0
