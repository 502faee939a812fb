"""From the pipeline's results to the records that go out, live and in replay."""

from __future__ import annotations

from datetime import datetime

from lumpwatch.service.core import (
    AlarmChange,
    AlarmClass,
    Change,
    Clocks,
    Decision,
    FeedState,
    LipReason,
    LumpSize,
    RoiResult,
    utc,
)
from lumpwatch.service.protocol.messages import (
    AlarmData,
    AlarmEvent,
    BlockageRecord,
    FeedRecord,
    Latency,
    Level,
    ObjectRecord,
    SizeRecord,
    StateLine,
    StateMessage,
    Timing,
)


def timing_of(result: RoiResult, clocks: Clocks) -> Timing | None:
    """Capture and decision of a result that was decided at the moment `clocks`."""
    if result.frame is None:
        return None
    age = clocks.monotonic_s - result.frame.capture_s
    return Timing(captured=utc(clocks.wall_s - age), decided=utc(clocks.wall_s), age_s=round(age, 6))


def objects_of(result: RoiResult) -> tuple[ObjectRecord, ...]:
    """The objects of a result, rounded to what means something."""
    if result.detection is None:
        return ()
    return tuple(
        ObjectRecord(
            x=round(found.x, 2),
            y=round(found.y, 2),
            w=round(found.w, 2),
            h=round(found.h, 2),
            existence=round(found.existence, 6),
            model=found.model,
            id=found.id,
            spread_x=round(found.spread_x, 2),
            spread_y=round(found.spread_y, 2),
            model_shares={name: round(share, 4) for name, share in found.model_shares},
            wrong_way=found.wrong_way,
            size=None if found.size is None else _size(found.size),
            counts=found.counts,
            not_counted=found.not_counted,
        )
        for found in result.detection.objects
    )


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _size(size: LumpSize) -> SizeRecord:
    return SizeRecord(
        longest_mm=_rounded(size.longest_mm, 0),
        low_mm=_rounded(size.low_mm, 0),
        high_mm=_rounded(size.high_mm, 0),
        equivalent_mm=_rounded(size.equivalent_mm, 0),
        over_limit=round(size.over_limit, 4),
        speed_m_s=round(size.speed_m_s, 3),
        distance_m=round(size.distance_m, 3),
        lip_s=_rounded(size.lip_s, 2),
        lip_spread_s=_rounded(size.lip_spread_s, 2),
    )


def feed_of(result: RoiResult) -> FeedRecord | None:
    """What the feed does; unknown while the region is BLIND."""
    feed = result.feed
    if feed is None:
        return None
    runs = None if feed.plant is None else feed.plant.runs
    speed = None if feed.plant is None else feed.plant.speed_mm_s
    if result.decision is Decision.BLIND:
        return FeedRecord(state=FeedState.UNKNOWN, plant_runs=runs, plant_speed_mm_s=speed)
    newest_s = None if result.frame is None else result.frame.capture_s
    lasted_s = None if newest_s is None or feed.since_s is None else newest_s - feed.since_s
    seen = feed.visible
    return FeedRecord(
        state=feed.state,
        for_s=_rounded(lasted_s, 2),
        speed_mm_s=_rounded(feed.speed_mm_s, 1),
        speed_px_s=_rounded(feed.speed_px_s, 2),
        load=_rounded(feed.load, 3),
        plant_runs=runs,
        plant_speed_mm_s=speed,
        agrees=feed.agrees,
        visible_p50_mm=None if seen is None else round(seen.p50_mm),
        visible_p80_mm=None if seen is None else round(seen.p80_mm),
        visible_stones=None if seen is None else seen.stones,
    )


def blockage_of(result: RoiResult) -> BlockageRecord | None:
    """What the mouth looks like."""
    found = result.blockage
    if found is None:
        return None
    return BlockageRecord(
        standing=round(found.standing, 3), stood_s=round(found.stood_s, 2), reason=found.reason
    )


def oversize(result: RoiResult) -> float | None:
    """Probability that a lump above the limit is there."""
    if result.detection is None or result.detection.oversize is None:
        return None
    return round(result.detection.oversize, 6)


def soonest(result: RoiResult) -> float | None:
    """Seconds until the first lump reaches the lip."""
    found = result.detection.counted if result.detection is not None else ()
    times = [
        detected.size.lip_s
        for detected in found
        if detected.size is not None and detected.size.lip_s is not None
    ]
    return round(min(times), 2) if times else None


def lip_reason(result: RoiResult) -> LipReason | None:
    """Why the seconds until the lip are not known; None where they are."""
    if soonest(result) is not None:
        return None
    detection = result.detection
    if detection is None or (not detection.counted and detection.oversize is not None):
        return LipReason.NO_OBJECT
    if detection.oversize is None:
        return LipReason.UNCALIBRATED
    reasons = {found.size.lip_reason for found in detection.counted if found.size is not None}
    return LipReason.UNCERTAIN if LipReason.UNCERTAIN in reasons else LipReason.NOT_MOVING


def state_line(result: RoiResult, camera: str, start_s: float) -> StateLine:
    """One line of `states.jsonl`; times count from `start_s`."""
    return StateLine(
        frame=_number(result),
        time_s=_time(result, start_s),
        camera=camera,
        roi=result.roi,
        state=result.decision,
        reason=result.reason if result.decision is Decision.BLIND else None,
        existence=round(result.existence, 6),
        oversize=oversize(result),
        objects=objects_of(result),
        unlocated=result.unlocated,
        feed=feed_of(result),
        blockage=blockage_of(result),
    )


def state_message(
    result: RoiResult, site: str, camera: str, clocks: Clocks, sequence: int = 0
) -> StateMessage:
    """The state of a ROI on the bus; `sequence` is that of its last alarm record."""
    return StateMessage(
        frame=_number(result),
        time_s=_time(result, 0.0),
        camera=camera,
        roi=result.roi,
        state=result.decision,
        existence=round(result.existence, 6),
        oversize=oversize(result),
        objects=objects_of(result),
        unlocated=result.unlocated,
        feed=feed_of(result),
        blockage=blockage_of(result),
        site=site,
        alarm=result.alarm.state.value,
        blind_alarm=result.blind_alarm.state.value,
        alarms={alarm_class: alarm.state for alarm_class, alarm in result.alarms.items()},
        sequence=sequence,
        reason=result.reason,
        timing=timing_of(result, clocks),
        prior=result.prior,
        trained=result.prior != 0 or result.blockage is not None,  # a mouth is not taught
    )


def level_of(result: RoiResult, sequence: int, valid_s: float) -> Level:
    """The least that a PLC gateway needs."""
    return Level(
        lump=1 if result.alarm.active else 0,
        blind=1 if result.decision is Decision.BLIND else 0,
        system=1 if result.alarms[AlarmClass.SYSTEM].active else 0,
        alarm=result.alarm.state.value,
        blind_alarm=result.blind_alarm.state.value,
        system_alarm=result.alarms[AlarmClass.SYSTEM].state.value,
        blocked=1 if result.alarms[AlarmClass.BLOCKED].active else 0,
        blocked_alarm=result.alarms[AlarmClass.BLOCKED].state.value,
        feed=(FeedState.UNKNOWN if (feed := feed_of(result)) is None else feed.state).value,
        sequence=sequence,
        valid_s=valid_s,
    )


def alarm_event(
    result: RoiResult,
    change: AlarmChange,
    site: str,
    camera: str,
    sequence: int,
    clocks: Clocks,
    *,
    start_s: float = 0.0,
    latency: Latency | None = None,
    evidence: str | None = None,
    test: bool = False,
) -> AlarmEvent:
    """The record of one change in a result; `sequence` makes its id unique within the source."""
    transition = change.transition
    lip_s, timing = soonest(result), timing_of(result, clocks)
    return AlarmEvent(
        id=record_id(clocks, sequence),
        source=f"/lumpwatch/{site}/{camera}/{result.roi}",
        type=f"io.lumpwatch.alarm.{transition.change.value}.v1",
        subject=f"{camera}/{result.roi}",
        time=utc(clocks.wall_s),
        data=AlarmData(
            site=site,
            camera=camera,
            roi=result.roi,
            alarm_class=change.alarm_class,
            priority=change.priority,
            sequence=sequence,
            change=transition.change,
            state=transition.after.value,
            previous=transition.before.value,
            frame=_number(result),
            time_s=_time(result, start_s),
            existence=round(result.existence, 6),
            oversize=oversize(result),
            lip_s=lip_s,
            left_s=None if lip_s is None or timing is None else round(lip_s - timing.age_s, 2),
            lip_reason=lip_reason(result),
            objects=objects_of(result),
            timing=timing,
            latency=latency,
            actor=transition.actor,
            reason=transition.reason,
            until=_until(change, clocks),
            prior=result.prior,
            evidence=evidence,
            test=test,
        ),
    )


def record_id(clocks: Clocks, sequence: int) -> str:
    """Id of an alarm record: unique within a ROI, rising with time."""
    return f"{round(clocks.wall_s * 1000):015d}-{sequence:06d}"


def _until(change: AlarmChange, clocks: Clocks) -> datetime | None:
    made, alarm = change.transition.change, change.alarm
    hold = None
    if made is Change.SHELVED:
        hold = alarm.shelved
    elif made is Change.SUPPRESSED:
        hold = alarm.suppressed[-1] if alarm.suppressed else None
    if hold is None or hold.until_s is None:
        return None
    return utc(clocks.wall_s + hold.until_s - clocks.monotonic_s)


def _number(result: RoiResult) -> int:
    return 0 if result.frame is None else result.frame.seq + 1


def _time(result: RoiResult, start_s: float) -> float:
    return 0.0 if result.frame is None else round(result.frame.capture_s - start_s, 6)
