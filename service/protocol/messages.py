"""What goes out: state lines, alarm records, heartbeats. JSON with a published schema."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import AliasChoices, BaseModel, ConfigDict, Field

from lumpwatch.service.core import (
    AlarmClass,
    AlarmState,
    BlindReason,
    BlockedReason,
    Change,
    Decision,
    FeedState,
    LipReason,
    NotCounted,
    Priority,
    Unlocated,
)


class Record(BaseModel):
    """Base of all messages: unknown keys are ignored by readers, so that v1 can grow."""

    model_config = ConfigDict(
        frozen=True, use_attribute_docstrings=True, json_schema_serialization_defaults_required=True
    )

    def line(self) -> bytes:
        """One line of JSON."""
        return self.model_dump_json(by_alias=True).encode()


class SizeRecord(Record):
    """An object on a calibrated belt."""

    longest_mm: float | None = None
    """Longest diameter; null as long as it was not seen as a whole."""
    low_mm: float | None = None
    """Lower end of the interval that holds it with 90 %."""
    high_mm: float | None = None
    """Upper end of that interval."""
    equivalent_mm: float | None = None
    """Diameter of a sphere that covers as much of the picture."""
    over_limit: float = 1.0
    """Probability that the longest diameter is above the limit; 1 where that is not known, 0 for what was first
    seen at the lip."""
    speed_m_s: float
    """Speed on the belt."""
    distance_m: float
    """Distance to the lip; negative beyond it."""
    lip_s: float | None = None
    """Seconds until it reaches the lip; null where it does not move towards it."""
    lip_spread_s: float | None = None
    """Standard deviation of `lip_s`."""


class ObjectRecord(Record):
    """One object, in full-frame pixels."""

    x: float
    """Left edge of the box, px."""
    y: float
    """Upper edge of the box, px."""
    w: float
    """Width of the box, px."""
    h: float
    """Height of the box, px."""
    existence: float
    """Probability that the object exists."""
    model: str
    """Its most probable motion model."""
    id: int
    """The same for as long as the object is followed."""
    spread_x: float
    """Standard deviation of the centre along x, px."""
    spread_y: float
    """Standard deviation of the centre along y, px."""
    model_shares: dict[str, float] = Field(default_factory=dict)
    """Probability of each motion model by its name."""
    wrong_way: bool = False
    """Whether it moves against the configured direction."""
    size: SizeRecord | None = None
    """Size, speed and time to the lip; null without a calibration."""
    counts: bool = True
    """Whether it counts for the alarm."""
    not_counted: NotCounted | None = None
    """Why it does not: smaller or larger than what is to be found; null where it does."""


class FeedRecord(Record):
    """What the feed of a region does. Null means that it is not known, never zero."""

    state: FeedState
    """`running`; `stopped`: material stands; `empty`: hardly any material lies there; or `unknown`, as it is while the
    region is BLIND."""
    for_s: float | None = None
    """For how long it has been in that state, seconds of capture time; null: nothing has been seen yet."""
    speed_mm_s: float | None = None
    """Speed of the belt towards the lip, measured on the material; 0 while it stands; null where it is not known, and
    without a calibration."""
    speed_px_s: float | None = None
    """Median speed of what is seen to move, pixels of the picture a second; 0 while it stands."""
    load: float | None = None
    """Share of the belt that is covered with material, 0 to 1."""
    plant_runs: bool | None = None
    """Whether the feeder runs by the plant's signal, as long as that is valid."""
    plant_speed_mm_s: float | None = None
    """Speed of the belt by the plant's signal."""
    agrees: bool | None = None
    """Whether the plant's signal agrees with what is seen; null: there is none, or nothing to compare it with."""
    visible_p50_mm: float | None = None
    """Size that half of the visible stones' area lies below: a trend, not a sieve. Fines, what lies beneath, and the
    covered part of overlapping stones are not seen; coarse stones come to the top. Null without a calibration, and
    until enough stones were seen."""
    visible_p80_mm: float | None = None
    """The same for four fifths of the area."""
    visible_stones: int | None = None
    """From so many measurements of stones."""


class BlockageRecord(Record):
    """What a crusher's mouth or a chute looks like."""

    standing: float
    """Share of the mouth in which material stands still, 0 to 1."""
    stood_s: float
    """For how long enough of it has stood without a break while the feed runs, seconds."""
    reason: BlockedReason | None = None
    """Why it counts as blocked, before the alarm's delay; null: it does not."""


class StateLine(Record):
    """The decision of one ROI on one frame, as `states.jsonl` holds it."""

    frame: int
    """Frame number, from 1; 0 where no frame has come yet."""
    time_s: float
    """Capture time, seconds (replay: since the start of the file)."""
    camera: str
    """Camera id."""
    roi: str
    """ROI id."""
    state: Decision
    """CLEAR, LUMP or BLIND; BLOCKED in the place of LUMP for a region that watches a mouth."""
    existence: float
    """Probability that a lump is there."""
    objects: tuple[ObjectRecord, ...] = ()
    """A lump filter's objects that are more likely there than not; all objects that a tracker stands by, of which those
    with `counts` make up the alarm."""
    oversize: float | None = None
    """Probability that a lump is there that counts as above the limit (`alarm.oversize_above`), which the alarm
    judges; null without a calibration."""
    unlocated: Unlocated | None = None
    """Why the state is LUMP though no object that counts is listed; null in any other case."""
    feed: FeedRecord | None = None
    """What the feed does; null where it is not looked at."""
    blockage: BlockageRecord | None = None
    """What the mouth looks like; null for a region that watches a belt."""
    reason: BlindReason | None = None
    """Why the ROI is BLIND; null in any other state."""


class Timing(Record):
    """When a frame was captured, received and decided, and what that took."""

    captured: datetime
    """Capture time on the wall clock (UTC)."""
    decided: datetime
    """Decision time on the wall clock (UTC)."""
    age_s: float
    """Seconds from capture to decision, by the monotonic clock."""


class Latency(Record):
    """What the way of a frame took, stage by stage, seconds; their sum is `total_s`."""

    receive_s: float
    """From capture to the decoded picture in the camera's process."""
    bus_s: float
    """From there, over the bus, until the monitor took it."""
    decision_s: float
    """From there to the decision: cut and filter of all ROIs of the camera."""
    publish_s: float
    """What bringing the result before it onto the bus took: its own cannot be known while it is written."""
    total_s: float
    """From capture to publication."""
    budget_s: float
    """What the camera's configuration allows."""


class StateMessage(StateLine):
    """The state of a ROI on the bus."""

    site: str
    """Site id."""
    alarm: str
    """State of the lump alarm: NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED, LATCHED, or why it is not
    announced: SHELVED, SUPPRESSED, OUT_OF_SERVICE."""
    blind_alarm: str = "NORMAL"
    """State of the blind alarm, in the same words."""
    alarms: dict[AlarmClass, AlarmState] = Field(default_factory=dict)
    """State of each class of alarm."""
    sequence: int = 0
    """Sequence of the ROI's last alarm record; 0: there was none."""
    timing: Timing | None = None
    """None where no frame has come yet."""
    prior: int = 0
    """Version of the prior in use; 0: the stated defaults."""
    trained: bool = False
    """Whether the region knows its site: false where it runs on the stated defaults and the net that ships alone, which
    finds fewer lumps and raises more false alarms; a region that watches a mouth needs no prior."""


class Level(Record):
    """The least that a PLC gateway needs; trust nothing older than `valid_s`."""

    lump: Literal[0, 1]
    """1 while the condition of the lump alarm is active, whether it is announced or not."""
    blind: Literal[0, 1]
    """1 while the ROI cannot judge."""
    system: Literal[0, 1] = 0
    """1 while the condition of the system alarm is active: decisions come late, or a proof test failed."""
    blocked: Literal[0, 1] = 0
    """1 while the condition of the blocked alarm is active; always 0 for a region that watches a belt."""
    alarm: str
    """State of the lump alarm."""
    blind_alarm: str
    """State of the blind alarm."""
    system_alarm: str = "NORMAL"
    """State of the system alarm."""
    blocked_alarm: str = "NORMAL"
    """State of the blocked alarm."""
    feed: str = FeedState.UNKNOWN.value
    """What the feed does: `running`, `stopped`, `empty` or `unknown`."""
    sequence: int
    """Sequence of the ROI's last alarm record; 0: there was none."""
    valid_s: float
    """A consumer that hears nothing for longer goes to its safe state."""


class AlarmData(Record):
    """The content of an alarm record."""

    site: str
    """Site id."""
    camera: str
    """Camera id."""
    roi: str
    """ROI id."""
    alarm_class: AlarmClass = Field(
        default=AlarmClass.LUMP,
        validation_alias=AliasChoices("class", "alarm_class"),
        serialization_alias="class",
    )
    """`lump`; `blind`: the ROI cannot judge; `system`: it judges, but too late, or a proof test failed; or `blocked`:
    material stands in the mouth that it watches."""
    priority: Priority = "high"
    """How soon an operator must respond."""
    sequence: int = 0
    """Rises by one from record to record of a ROI, over restarts too; the same number is the same record."""
    change: Change
    """What happened; `active` and `inactive` are the condition while it is shelved, suppressed or out of service."""
    state: str
    """State of the alarm after it."""
    previous: str
    """State of the alarm before it."""
    frame: int
    """Number of the frame that decided."""
    time_s: float
    """Capture time of that frame, seconds on the source's monotonic clock (replay: since the start)."""
    existence: float
    """Probability that a lump is there."""
    oversize: float | None = None
    """Probability that a lump is there that counts as above the limit (`alarm.oversize_above`), which the alarm
    judges; null without a calibration."""
    lip_s: float | None = None
    """Seconds from the capture until the first lump reaches the lip; null where that is not known."""
    left_s: float | None = None
    """Seconds that are left from `time` until then: `lip_s` less what the decision took."""
    lip_reason: LipReason | None = None
    """Why `lip_s` is null."""
    objects: tuple[ObjectRecord, ...] = ()
    """The estimate."""
    timing: Timing | None = None
    """Capture and decision time."""
    latency: Latency | None = None
    """What each stage took; null where no frame has been decided, and in a replay."""
    actor: str | None = None
    """Who did it; null: the machine."""
    reason: str | None = None
    """Why: as the operator said, the plant's signal, what makes the ROI blind, or what the system suffers from."""
    until: datetime | None = None
    """When the hold that begins ends by itself (UTC)."""
    prior: int = 0
    """Version of the prior in use."""
    evidence: str | None = None
    """Id of the evidence that is being recorded, on `raised`; it can be fetched after the post-roll."""
    test: bool = False
    """Whether this is the alarm of a proof test; such records appear on the test key only."""


class AlarmEvent(Record):
    """An alarm record: CloudEvents 1.0 in JSON."""

    specversion: Literal["1.0"] = "1.0"
    """Version of CloudEvents."""
    id: str
    """Unique within `source`; rises with time."""
    source: str
    """`/lumpwatch/{site}/{camera}/{roi}`."""
    type: str
    """`io.lumpwatch.alarm.{change}.v1`."""
    subject: str
    """`{camera}/{roi}`."""
    time: datetime
    """Decision time on the wall clock (UTC)."""
    datacontenttype: Literal["application/json"] = "application/json"
    """Type of `data`."""
    data: AlarmData
    """What happened, where, and by which evidence."""


class RoiBeat(Record):
    """The part of one ROI in a heartbeat."""

    state: Decision
    """CLEAR, LUMP or BLIND."""
    decided_ago_s: float | None
    """Seconds since the last decision on a frame; null: none yet."""
    decided: datetime | None = None
    """Wall clock (UTC) of that decision."""
    valid: bool
    """Whether `state` may be trusted: it is BLIND, or was decided within the camera's `blind_after_s`."""


class Heartbeat(Record):
    """Sent once a second by the monitor of a camera; trust nothing older than `valid_s`, nor one that is not valid."""

    site: str
    """Site id."""
    camera: str
    """Camera id."""
    seq: int
    """Counts the heartbeats of this monitor."""
    time: datetime
    """Wall clock (UTC)."""
    valid_s: float
    """A consumer that hears nothing for longer, by its own monotonic clock, goes to its safe state."""
    valid: bool
    """False: decisions have stopped though the process lives; as if no heartbeat had come."""
    rois: dict[str, RoiBeat] = Field(default_factory=dict)
    """Each ROI."""
