"""One example of each message, as the AsyncAPI document shows it."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from typing import Any

from pydantic import BaseModel

from lumpwatch.service.bus import FrameHeader
from lumpwatch.service.core import AlarmClass, AlarmState, Change, Decision, FeedState
from lumpwatch.service.protocol.commands import COMMANDS, FeedReply
from lumpwatch.service.protocol.evidence import EvidenceMeta, StoredFile
from lumpwatch.service.protocol.messages import (
    AlarmData,
    AlarmEvent,
    FeedRecord,
    Heartbeat,
    Latency,
    Level,
    ObjectRecord,
    RoiBeat,
    SizeRecord,
    StateLine,
    StateMessage,
    Timing,
)
from lumpwatch.service.protocol.proof import (
    SHOWS_LABELLED,
    BlendPlan,
    BlendReply,
    LumpAt,
    Outcome,
    ProofResult,
)
from lumpwatch.service.protocol.requests import ActReply
from lumpwatch.service.protocol.shadow import ShadowState
from lumpwatch.service.protocol.verdict import VerdictOutcome, VerdictReply

_SITE, _CAMERA, _ROI = "north-pit", "crusher-1", "apron"
_DECIDED = datetime(2026, 3, 14, 5, 9, 26, 535_000, UTC)
_OBJECT = ObjectRecord(
    x=612.5,
    y=301.0,
    w=148.2,
    h=121.7,
    existence=0.991,
    model="belt",
    id=17,
    spread_x=3.1,
    spread_y=2.6,
    model_shares={"belt": 0.98, "fall": 0.02},
    size=SizeRecord(
        longest_mm=1310.0,
        low_mm=1040.0,
        high_mm=1650.0,
        equivalent_mm=1120.0,
        over_limit=0.86,
        speed_m_s=0.42,
        distance_m=1.9,
        lip_s=4.52,
        lip_spread_s=0.4,
    ),
)
_TIMING = Timing(captured=_DECIDED - timedelta(seconds=0.123), decided=_DECIDED, age_s=0.123)
_SEEN: dict[str, Any] = {
    "frame": 48_211,
    "camera": _CAMERA,
    "roi": _ROI,
    "existence": 0.991,
    "oversize": 0.86,
    "objects": (_OBJECT,),
}
_FEED = FeedRecord(
    state=FeedState.RUNNING,
    for_s=812.4,
    speed_mm_s=598.0,
    speed_px_s=71.3,
    load=0.93,
    plant_runs=True,
    plant_speed_mm_s=600.0,
    agrees=True,
    visible_p50_mm=210,
    visible_p80_mm=340,
    visible_stones=412,
)
_STATES = {
    AlarmClass.LUMP: AlarmState.UNACKNOWLEDGED,
    AlarmClass.BLIND: AlarmState.NORMAL,
    AlarmClass.SYSTEM: AlarmState.NORMAL,
    AlarmClass.BLOCKED: AlarmState.NORMAL,
}

_MODELS: tuple[BaseModel, ...] = (
    AlarmEvent(
        id="001773464966535-000012",
        source=f"/lumpwatch/{_SITE}/{_CAMERA}/{_ROI}",
        type="io.lumpwatch.alarm.raised.v1",
        subject=f"{_CAMERA}/{_ROI}",
        time=_DECIDED,
        data=AlarmData(
            **_SEEN,
            site=_SITE,
            sequence=12,
            change=Change.RAISED,
            state=AlarmState.UNACKNOWLEDGED,
            previous=AlarmState.NORMAL,
            time_s=8_035.16,
            lip_s=4.52,
            left_s=4.4,
            timing=_TIMING,
            latency=Latency(
                receive_s=0.062,
                bus_s=0.021,
                decision_s=0.04,
                publish_s=0.004,
                total_s=0.127,
                budget_s=1.0,
            ),
            prior=3,
        ),
    ),
    StateMessage(
        **_SEEN,
        time_s=8_035.16,
        state=Decision.LUMP,
        site=_SITE,
        alarm=AlarmState.UNACKNOWLEDGED,
        alarms=_STATES,
        sequence=12,
        timing=_TIMING,
        prior=3,
        feed=_FEED,
    ),
    StateLine(**_SEEN, time_s=12.4, state=Decision.LUMP, feed=_FEED),
    Heartbeat(
        site=_SITE,
        camera=_CAMERA,
        seq=8_036,
        time=_DECIDED,
        valid_s=3.0,
        valid=True,
        rois={_ROI: RoiBeat(state=Decision.LUMP, decided_ago_s=0.031, decided=_DECIDED, valid=True)},
    ),
    Level(
        lump=1,
        blind=0,
        alarm=AlarmState.UNACKNOWLEDGED,
        blind_alarm=AlarmState.NORMAL,
        sequence=12,
        valid_s=3.0,
        feed=FeedState.RUNNING,
    ),
    FrameHeader(
        v=1,
        clock="0123456789abcdef",
        seq=48_210,
        capture_ns=8_035_160_000_000,
        received_ns=8_035_222_000_000,
        wall_ns=1_773_464_966_474_000_000,
        size=(1920, 1080),
        crop=(288, 108, 1344, 944),
        reduction=2,
        encoding="gray8",
        pixels="gray8",
        shape=(472, 672),
    ),
    ShadowState(
        camera=_CAMERA,
        roi=_ROI,
        version=4,
        current=3,
        since=_DECIDED - timedelta(hours=8),
        time=_DECIDED,
        existence=0.993,
        lump=True,
        agree_s=28_731.4,
        only_current_s=12.6,
        only_shadow_s=56.0,
        both=11,
        only_current=0,
        only_shadow=2,
        lead_s=3.7,
        frames=431_120,
        skipped=880,
    ),
    ActReply(
        alarm_class=AlarmClass.LUMP,
        changes=(Change.ACKNOWLEDGED,),
        alarm=AlarmState.ACKNOWLEDGED,
        active=True,
        sequence=13,
        acknowledged=True,
    ),
    FeedReply(taken=True),
    VerdictReply(verdict=VerdictOutcome.FALSE, sequence=12, alarm="001773464966535-000012", written=True),
    ProofResult(
        site=_SITE,
        camera=_CAMERA,
        roi=_ROI,
        time=_DECIDED,
        outcome=Outcome.PASSED,
        warning_s=5.1,
        existence=0.998,
        prior=3,
        actor="anna",
        lump="lump 5 of crusher-1.mp4, the hardest",
        shows=SHOWS_LABELLED,
    ),
    BlendPlan(
        roi=_ROI,
        path=(LumpAt(t_s=2.0, x=0.5, y=0.1, w=0.08, h=0.11), LumpAt(t_s=9.0, x=0.5, y=0.95, w=0.1, h=0.14)),
        lasts_s=10.0,
    ),
    BlendReply(accepted=True),
    EvidenceMeta(
        id="001763791200000-000012",
        site=_SITE,
        camera=_CAMERA,
        roi=_ROI,
        alarm_class=AlarmClass.LUMP,
        sequence=12,
        time=_DECIDED,
        frames=231,
        decisive=157,
        pre_roll_s=10.4,
        post_roll_s=4.93,
        ended="post_roll",
        existence=0.934,
        prior=3,
        exact=True,
        software="0.1.0",
        files={"still.jpg": StoredFile(size=48213, sha256=64 * "a")},
    ),
    *(command.example for command in COMMANDS.values()),
)


def example(model: type[BaseModel]) -> Any:
    """The example of a message, as plain data."""
    (found,) = (message for message in _MODELS if type(message) is model)
    return json.loads(found.model_dump_json(by_alias=True))
