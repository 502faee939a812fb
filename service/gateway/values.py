"""What the gateway says of a site: one immutable set of values, the same for every transport.

None means "not available" and nothing else: a transport has to say so in its own way, and never as a zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import IntEnum

from lumpwatch.service.core import AlarmClass, AlarmState, BlindReason, Decision


class Quality(IntEnum):
    """Whether a region may be believed, with the numbers that OPC gave these words. A register that was never
    written is Bad.
    """

    BAD = 0
    UNCERTAIN = 64
    GOOD = 192


class Why(IntEnum):
    """Why the quality is as it is. Numbers are for ever: new ones come at the end."""

    GOOD = 1
    """The region sees and its heartbeat is valid."""
    STARTING = 2
    """Nothing has been heard of the region since the gateway started."""
    NO_BUS = 3
    """The gateway does not reach the bus."""
    PROCESS_GONE = 4
    """The daemon or the camera's monitor has ended: its liveliness token is gone."""
    HEARTBEAT_EXPIRED = 5
    """The last heartbeat of the camera's monitor is older than it may be."""
    HEARTBEAT_INVALID = 6
    """The monitor says by itself that its decisions must not be trusted."""
    STATE_EXPIRED = 7
    """Heartbeats come, but the region's state or level does not."""
    NOT_DECIDING = 8
    """The last decision on a frame is older than the camera's limit."""
    BLIND = 9
    """The region cannot see; the BLIND reason says why."""
    DEGRADED = 10
    """Uncertain: the region sees, but its system alarm is active: late decisions, or a failed proof test."""


@dataclass(frozen=True, slots=True)
class FeedValues:
    """What the feed does, where the region tells."""

    state: str | None = None
    """`running`, `stopped`, `empty` or `unknown`."""
    speed_mm_s: float | None = None
    load: float | None = None
    """Share of the belt that is covered."""
    visible_p80_mm: float | None = None


@dataclass(frozen=True, slots=True)
class MouthValues:
    """What a mouth looks like, where the region watches one."""

    standing: float | None = None
    """Share of it in which material stands."""
    stood_s: float | None = None
    """For how long enough of it has stood while the feed ran."""


@dataclass(frozen=True, slots=True)
class RegionValues:
    """One region, at one moment."""

    camera: str
    roi: str
    quality: Quality = Quality.BAD
    why: Why = Why.STARTING
    lives: bool = False
    """Whether the whole chain lives, from the camera's frame to this process."""
    heartbeat: int = 0
    """Rises while it does, from 1 to 65535 and again from 1; 0: it has not lived yet."""
    decision: Decision | None = None
    blind_reason: BlindReason | None = None
    alarms: Mapping[AlarmClass, AlarmState] = field(default_factory=dict)
    """Where the alarms stand; those that are missing are not available."""
    lump: bool | None = None
    """Whether the condition of the lump alarm is active, announced or not."""
    system: bool | None = None
    """Whether that of the system alarm is."""
    blocked: bool | None = None
    """Whether that of the blocked alarm is; of a region that watches a mouth."""
    existence: float | None = None
    count: int | None = None
    """How many lumps are located that count for the alarm."""
    largest_mm: float | None = None
    """Longest diameter of the largest of them."""
    lip_s: float | None = None
    """Seconds until the first of them reaches the lip, from the moment of these values."""
    speed_mm_s: float | None = None
    """Speed of that one."""
    limit_mm: float | None = None
    """Configured size limit."""
    prior: int | None = None
    """Version of the prior in use; 0: the stated defaults."""
    trained: bool | None = None
    sequence: int | None = None
    """Of the region's last alarm record; 0: there was none."""
    feed: FeedValues = field(default_factory=FeedValues)
    mouth: MouthValues = field(default_factory=MouthValues)
    decided: datetime | None = None
    """Wall clock (UTC) of the decision that these values come from."""

    @property
    def name(self) -> str:
        """CAMERA/ROI."""
        return f"{self.camera}/{self.roi}"

    @property
    def clear(self) -> bool:
        """The only thing that releases anything: seen, judged, good, and no sign of a lump or a blockage."""
        seen = self.quality is Quality.GOOD and self.decision is Decision.CLEAR
        return seen and self.lump is False and self.blocked is False


@dataclass(frozen=True, slots=True)
class SiteValues:
    """All regions at one moment, in the order of the map."""

    site: str
    heartbeat: int
    """Rises while the chains of all regions live."""
    regions: tuple[RegionValues, ...]

    @property
    def quality(self) -> Quality:
        """The worst of all regions."""
        return min((region.quality for region in self.regions), default=Quality.BAD)


def following(counter: int) -> int:
    """The next value of a heartbeat counter of 16 bits, which never returns to 0."""
    return counter % 65535 + 1
