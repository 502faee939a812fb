"""What is decided of a region on a frame, and why it cannot be decided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from lumpwatch.models.picture.region import Measure
from lumpwatch.service.core.alarm import Alarm, AlarmClass, Priority, Transition
from lumpwatch.service.core.detection import Detection, Unlocated
from lumpwatch.service.core.feed import FeedStatus
from lumpwatch.service.core.frame import Frame


class Decision(StrEnum):
    """The decision of a ROI: CLEAR, BLIND, and LUMP on a belt or BLOCKED in a mouth."""

    CLEAR = "CLEAR"
    LUMP = "LUMP"
    BLIND = "BLIND"
    BLOCKED = "BLOCKED"
    """A mouth is blocked: in place of LUMP where a region watches one."""


class BlindReason(StrEnum):
    """Why a ROI cannot judge; of several reasons the first of this list is reported."""

    STARTING = "starting"
    """No frame has come yet, or the filter has not yet judged enough of them since it began; the latter is
    reported after all the others."""
    UNFIT = "unfit"
    """The region does not fit the picture: it has another size or shape than polygon, calibration or detector need."""
    NO_STREAM = "no_stream"
    """No frame comes."""
    STALE = "stale"
    """Frames come late."""
    FILTER = "filter"
    """The filter fails, has failed and not yet looked long enough since, or is starved of particles."""
    OVERLOAD = "overload"
    """Too few frames are judged, or too late."""
    FROZEN = "frozen"
    """The picture does not change."""
    DARK = "dark"
    """There is too little light."""
    GLARE = "glare"
    """Too much of the picture is saturated."""
    MOVED = "moved"
    """The camera has moved, or what it shows cannot be found in the reference."""
    DUSTY = "dusty"
    """A bright veil takes structure away."""
    HIDDEN = "hidden"
    """Too much of the region is featureless or replaced, or something stands before it while the belt moves."""
    BLURRED = "blurred"
    """Fine structure is gone."""
    EXPOSURE = "exposure"
    """Hold-off after the exposure has jumped."""
    FEW_FRAMES = "few_frames"
    """Fewer frames are judged than it takes to find a lump."""


class Trouble(StrEnum):
    """Why a ROI does not judge as well as it must: the reasons of the system alarm."""

    LATENCY = "latency"
    """Decisions have come later than the camera's budget allows."""
    PROOF_TEST = "proof_test"
    """The last proof test failed."""
    PROOF_OVERDUE = "proof_overdue"
    """The proof tests that the configuration asks for have not come to a result for too long."""
    SECOND_SOURCE = "second_source"
    """A second publisher sends frames under the name of the camera; they are refused."""
    SECOND_MONITOR = "second_monitor"
    """A second monitor announces under the name of the camera."""
    PRIOR = "prior"
    """The prior that is set to be used failed in use; the one before, or the stated defaults, stand in for it."""
    EVENT_LOG = "event_log"
    """The event log is not written, or was replaced by another."""
    RESTARTS = "restarts"
    """The monitor has ended by itself and been started again several times of late."""
    FEED_SIGNAL = "feed_signal"
    """The plant's signal of the feed has not agreed with what is seen for long."""


class BlockedReason(StrEnum):
    """What a blockage is known by."""

    STANDING = "standing"
    """Material has stood in the mouth without a break while the feed ran."""
    LUMP = "lump"
    """A lump that was followed into the mouth has not gone through."""


@dataclass(frozen=True, slots=True)
class Blockage:
    """What the mouth of a crusher looks like."""

    standing: float
    """Share of the mouth in which material stands still."""
    stood_s: float
    """For how long enough of it has, without a break while the feed runs."""
    reason: BlockedReason | None = None
    """Why it counts as blocked; None: it does not."""


@dataclass(frozen=True, slots=True)
class PictureQuality:
    """What is known of a ROI's picture."""

    reason: BlindReason | None = None
    """Why it is not fit."""
    suspect: bool = False
    """Whether the last picture alone is beyond a threshold: too early for a reason, reason enough for care."""
    held_off: bool = False
    """Whether the exposure has just jumped: the lump alarm is not judged."""
    holdoffs: int = 0
    """How many hold-offs have begun."""
    values: Mapping[Measure, float] = field(default_factory=dict)
    """The slow estimate of each measure."""
    thresholds: Mapping[Measure, float] = field(default_factory=dict)
    """What each is compared with."""
    offset_px: tuple[int, int] = (0, 0)
    """How far the region was moved along with the camera."""
    standing: tuple[int, ...] = ()
    """Identities of the objects that stand while the belt moves."""


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """A transition, of which alarm, and the alarm after all that happened at that moment."""

    alarm_class: AlarmClass
    transition: Transition
    alarm: Alarm
    priority: Priority


_LIKELY = 0.5


@dataclass(frozen=True, slots=True)
class RoiResult:
    """The decision of one ROI."""

    roi: str
    frame: Frame | None
    """None where no frame has come yet."""
    decision: Decision
    reason: BlindReason | None
    detection: Detection | None
    existence: float
    alarms: Mapping[AlarmClass, Alarm]
    prior: int
    decided: bool
    """Whether this result comes from filtering a new frame."""
    changes: tuple[AlarmChange, ...] = ()
    """What happened to the alarms, in order."""
    taken_s: float | None = None
    """When the pipeline got the frame, on the clock of its `received_s`; None where no frame has come yet."""
    quality: PictureQuality = PictureQuality()
    """What is known of the picture."""
    feed: FeedStatus | None = None
    """What the feed does; None where that is not looked at."""
    blockage: Blockage | None = None
    """What a mouth looks like; None on a belt, and before anything was seen."""

    @property
    def alarm(self) -> Alarm:
        """Of class lump."""
        return self.alarms[AlarmClass.LUMP]

    @property
    def blind_alarm(self) -> Alarm:
        """Of class blind."""
        return self.alarms[AlarmClass.BLIND]

    @property
    def fit(self) -> bool:
        """Whether it comes from a new frame of a picture that is fit: only such teach anything."""
        return self.decided and self.reason is None

    @property
    def unlocated(self) -> Unlocated | None:
        """Why the state is LUMP without an object that counts; None in any other case."""
        found = self.detection
        if self.decision is not Decision.LUMP or (found is not None and found.counted):
            return None
        return Unlocated.SPREAD if found is not None and found.alarming > _LIKELY else Unlocated.HELD

    @property
    def transition(self) -> Transition | None:
        """The first change of the lump alarm."""
        return next((c.transition for c in self.changes if c.alarm_class is AlarmClass.LUMP), None)
