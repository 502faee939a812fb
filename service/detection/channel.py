"""What every channel of a region answers to, whatever the region watches: a belt for lumps, or a mouth.

The pipeline, the alarms of a region and its snapshots know this interface alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from lumpwatch.models.roi import Roi
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmClass,
    BlindReason,
    Blockage,
    Decision,
    Detection,
    FeedStatus,
    Frame,
    PictureQuality,
    Transition,
)
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.snapshot import Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior


class RegionMisfitError(LumpwatchError):
    """A region's polygon or calibration makes no sense in pictures of this size."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What others know of a region's feed at the next frame."""

    feed: FeedStatus = field(default_factory=FeedStatus)
    """What the region of the belt sees of it."""
    plant_runs: bool | None = None
    """Whether the feeder runs by the plant's signal; None: it does not say."""
    lumps: Detection | None = None
    """What is followed on the belt; None: nothing is known."""


class Channel(Protocol):
    """Used by one thread. `fit` comes first; times are seconds on one clock and rise from step to step."""

    config: RoiConfig
    alarm: Alarm
    """The one that it steps."""
    prior: Prior | None
    """The one in use; None: the stated defaults, or that it has none."""
    detector: Detector | None
    """None as long as the channel is fit for no picture, and where it has none."""
    detection: Detection | None
    """Of the last step, in pixels of the picture; None before the first in pictures of this size."""
    geometry: Roi | None
    """The region as configured; None before the first fit."""
    size: tuple[int, int] | None
    """Width and height of the pictures it is fit for."""

    @property
    def alarm_class(self) -> AlarmClass:
        """Of the alarm that it steps."""

    @property
    def found(self) -> Decision:
        """What is decided while that alarm stands."""

    @property
    def belt(self) -> str | None:
        """The region of the same camera that it must hear of, which is then stepped first; None: none."""

    @property
    def feed(self) -> FeedStatus:
        """What the feed does, as far as it is known."""

    @property
    def blockage(self) -> Blockage | None:
        """What the mouth looks like; None where none is watched, and before anything was seen."""

    @property
    def unknown(self) -> BlindReason | None:
        """Why CLEAR cannot be said though the picture is fit; None: it can."""

    def unfit(self, quality: PictureQuality) -> BlindReason | None:
        """Why a picture of that quality is not fit to be judged; None: it is."""

    def hear(self, heard: Heard) -> None:
        """What others know of the feed, before the next step."""

    def fit(self, width: int, height: int) -> None:
        """Make it for pictures of that size; raises LumpwatchError where it does not fit them."""

    def step(
        self, frame: Frame, *, now_s: float | None = None, may_learn: bool = True, may_clear: bool = True
    ) -> Transition | None:
        """Judge one frame of the fitted size, and step the alarm at `now_s`; returns what became of it.

        `may_learn`: whether the picture may teach anything; `may_clear`: whether it may clear the alarm.
        """

    def begin_anew(self) -> None:
        """Forget what was seen, after it has failed; the alarm stays."""

    def use(self, prior: Prior | None) -> None:
        """Go on with another prior; raises LumpwatchError where it does not fit, and all is as before."""

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, but the prior's content and what is heard."""

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from there; raises StateMismatchError, and what `fit` raises."""
