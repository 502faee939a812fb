"""The state of a ROI between two frames, to go on from later."""

from __future__ import annotations

from dataclasses import dataclass, field

from lumpwatch.service.core import Alarm, AlarmClass, PaceState
from lumpwatch.service.detection.detectors.base import FilterState
from lumpwatch.service.detection.sight import SightState
from lumpwatch.service.detection.sizing import SizeTrack
from lumpwatch.service.storage import Prior


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All that a ROI's next decision depends on, but the frame and the prior's content."""

    last_capture_s: float | None
    """Capture time of the frame before; None: there was none."""
    size: tuple[int, int] | None
    """Width and height of that frame."""
    filter: FilterState | None
    """None before the first frame, and for detectors that cannot export it."""
    sizes: dict[int, SizeTrack]
    """What is remembered of the objects' sizes."""
    alarms: dict[AlarmClass, Alarm]
    prior: Prior | None
    sight: SightState = field(default_factory=SightState)
    """Which frames were judged."""
    pace: PaceState = field(default_factory=PaceState)
    """Which frame was decided on."""
    camera_pace: PaceState = field(default_factory=PaceState)
    """Which of the camera's frames was due in any region."""

    @property
    def exact(self) -> bool:
        """Whether a replay from here decides as the live pipeline did."""
        return self.filter is not None or self.last_capture_s is None
