"""From the messages of the bus to the values of a site: the one place that judges whether a region may be believed.

Messages arrive in threads of the bus and are kept as they came, with the moment of their arrival on this process'
own monotonic clock. Subscriptions have no history: a last value that the bus had kept may be of a monitor that is
dead. Whatever is not known, too old or not understood ends in Bad with the reason.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeVar

from pydantic import ValidationError

from lumpwatch.service.bus import Bus, Keys
from lumpwatch.service.config import CameraConfig, RoiConfig, SiteConfig
from lumpwatch.service.core import AlarmClass, AlarmState, BlindReason, Decision
from lumpwatch.service.gateway.values import (
    FeedValues,
    MouthValues,
    Quality,
    RegionValues,
    SiteValues,
    Why,
    following,
)
from lumpwatch.service.protocol import AlarmEvent, Heartbeat, Level, StateMessage

_Message = TypeVar("_Message", Heartbeat, StateMessage, Level, AlarmEvent)

BEAT_EVERY_S = 0.25
"""How often the heartbeat counters rise."""
_HEARTBEAT_PERIOD_S, _SLACK_S = 1.0, 0.5
"""A decision is told of once a second, so it may look older by that much."""
_NO_FRAMES = frozenset(
    {
        BlindReason.STARTING,
        BlindReason.UNFIT,
        BlindReason.NO_STREAM,
        BlindReason.STALE,
        BlindReason.FILTER,
        BlindReason.FROZEN,
    }
)
"""Of these BLIND reasons the chain is broken: no camera, or no filter, that works. The others are of the picture."""


@dataclass(slots=True)
class _Region:
    """What was heard of one region."""

    camera: CameraConfig
    roi: RoiConfig
    state: StateMessage | None = None
    state_s: float = float("-inf")
    level: Level | None = None
    level_s: float = float("-inf")
    changed: dict[AlarmClass, AlarmEvent] = field(default_factory=dict)
    """The last record of each class."""
    counter: int = 0


@dataclass(frozen=True, slots=True)
class _Beat:
    beat: Heartbeat
    heard_s: float


class Chain:
    """What is heard of a site, and what that comes to."""

    def __init__(
        self,
        config: SiteConfig,
        regions: tuple[tuple[str, str], ...],
        clock: Callable[[], float] = time.monotonic,
        on_news: Callable[[], None] = lambda: None,
    ) -> None:
        """`regions` in the order of the map; `on_news` is called, in any thread, when an alarm or a state came."""
        self._site = config.site
        self._keys = Keys(config.site)
        self._clock = clock
        self._on_news = on_news
        self._lock = threading.Lock()
        self._regions = {
            (camera, roi): _Region(config.camera(camera), config.camera(camera).roi(roi))
            for camera, roi in regions
        }
        self._beats: dict[str, _Beat] = {}
        self._alive: set[str] = set()
        self._counter = 0
        self._beaten_s = float("-inf")
        self.connected: Callable[[], bool] = lambda: False
        """Whether the bus is reached now."""
        self.malformed = 0
        """Messages that were not understood."""

    def follow(self, bus: Bus) -> None:
        """Subscribe to what is needed."""
        self.connected = lambda: bus.connected
        bus.watch_alive(self._keys.all_alive(), self.on_token)
        bus.subscribe(self._keys.heartbeats(), self.on_heartbeat)
        bus.subscribe(self._keys.levels(), self.on_level)
        bus.subscribe(self._keys.states(), self.on_state)
        bus.subscribe(self._keys.alarms(), self.on_alarm)

    def on_token(self, key: str, alive: bool) -> None:
        """A process has come or gone."""
        with self._lock:
            (self._alive.add if alive else self._alive.discard)(key)
        self._on_news()

    def on_heartbeat(self, key: str, payload: bytes) -> None:
        """A monitor says that it lives."""
        beat = self._read(Heartbeat, payload)
        if beat is not None:
            with self._lock:
                self._beats[beat.camera] = _Beat(beat, self._clock())

    def on_state(self, key: str, payload: bytes) -> None:
        """The state of a region."""
        region, state = self._region_of(key), self._read(StateMessage, payload)
        if region is None or state is None:
            return
        with self._lock:
            region.state, region.state_s = state, self._clock()
        self._on_news()

    def on_level(self, key: str, payload: bytes) -> None:
        """The level of a region."""
        region, level = self._region_of(key), self._read(Level, payload)
        if region is None or level is None:
            return
        with self._lock:
            news = region.level != level
            region.level, region.level_s = level, self._clock()
        if news:
            self._on_news()

    def on_alarm(self, key: str, payload: bytes) -> None:
        """An alarm record: it says where an alarm stands before the next state does."""
        region, event = self._region_of(key), self._read(AlarmEvent, payload)
        if region is None or event is None or event.data.test:
            return
        if event.data.state not in tuple(AlarmState):
            self.malformed += 1
            return
        with self._lock:
            region.changed[event.data.alarm_class] = event
        self._on_news()

    def values(self) -> SiteValues:
        """Everything as of now, with the heartbeat counters that go with it."""
        connected = self.connected()
        with self._lock:
            now = self._clock()
            due = now - self._beaten_s >= BEAT_EVERY_S
            if due:
                self._beaten_s = now
            judged = [self._judge(region, now, connected) for region in self._regions.values()]
            lives = [region.lives for region in judged]
            if due:
                for region, alive in zip(self._regions.values(), lives, strict=True):
                    region.counter = following(region.counter) if alive else region.counter
                if lives and all(lives):
                    self._counter = following(self._counter)
            counters = [region.counter for region in self._regions.values()]
            counter = self._counter
        return SiteValues(
            self._site,
            counter,
            tuple(_with(region, count) for region, count in zip(judged, counters, strict=True)),
        )

    def _judge(self, region: _Region, now: float, connected: bool) -> RegionValues:
        why = self._silent(region, now, connected)
        state, level = region.state, region.level
        if why is not None or state is None or level is None:
            return _unknown(region, why or Why.STARTING)
        alarms = {
            **state.alarms,
            **{
                alarm_class: AlarmState(event.data.state)
                for alarm_class, event in region.changed.items()
                if event.data.sequence > state.sequence
            },
        }
        blind = state.state is Decision.BLIND or level.blind == 1
        if blind:
            why, quality = Why.BLIND, Quality.BAD
        elif level.system == 1:
            why, quality = Why.DEGRADED, Quality.UNCERTAIN
        else:
            why, quality = Why.GOOD, Quality.GOOD
        told = RegionValues(
            region.camera.id,
            region.roi.id,
            quality=quality,
            why=why,
            lives=not (blind and (state.reason is None or state.reason in _NO_FRAMES)),
            decision=Decision.BLIND if blind else state.state,
            blind_reason=state.reason,
            alarms=alarms,
            lump=level.lump == 1,
            system=level.system == 1,
            blocked=level.blocked == 1,
            limit_mm=_limit(region.roi),
            prior=state.prior,
            trained=state.trained,
            sequence=max([state.sequence, *(event.data.sequence for event in region.changed.values())]),
            feed=_feed(state),
            decided=None if state.timing is None else state.timing.decided,
        )
        if blind:
            return told
        if region.roi.watches_mouth:  # it looks for no lumps: none is not what it has found
            return replace(told, mouth=_mouth(state))
        return _with_lumps(told, state, now - region.state_s)

    def _silent(self, region: _Region, now: float, connected: bool) -> Why | None:
        """Why nothing that was heard of a region counts; None: it does."""
        heard = self._beats.get(region.camera.id)
        if not connected:
            return Why.NO_BUS
        if heard is None or region.state is None or region.level is None:
            return Why.STARTING
        needed = (self._keys.alive("daemon", self._site), self._keys.alive("monitor", region.camera.id))
        if not self._alive.issuperset(needed):
            return Why.PROCESS_GONE
        valid_s = heard.beat.valid_s
        if now - heard.heard_s > valid_s:
            return Why.HEARTBEAT_EXPIRED
        beat = heard.beat.rois.get(region.roi.id)
        if beat is None or not beat.valid:
            return Why.HEARTBEAT_INVALID
        if now - region.state_s > valid_s or now - region.level_s > region.level.valid_s:
            return Why.STATE_EXPIRED
        if region.state.state is not Decision.BLIND:
            limit_s = region.camera.blind_after_s + _HEARTBEAT_PERIOD_S + _SLACK_S
            if beat.decided_ago_s is None or beat.decided_ago_s + now - heard.heard_s > limit_s:
                return Why.NOT_DECIDING
        return None

    def _read(self, model: type[_Message], payload: bytes) -> _Message | None:
        try:
            return model.model_validate_json(payload)
        except ValidationError:
            self.malformed += 1
            return None

    def _region_of(self, key: str) -> _Region | None:
        parts = key.split("/")
        return self._regions.get((parts[-3], parts[-2])) if len(parts) >= 3 else None


def _feed(state: StateMessage) -> FeedValues:
    """What a state message says of the feed; nothing where that is not looked at."""
    told = state.feed
    if told is None:
        return FeedValues()
    return FeedValues(told.state, told.speed_mm_s, told.load, told.visible_p80_mm)


def _mouth(state: StateMessage) -> MouthValues:
    told = state.blockage
    return MouthValues() if told is None else MouthValues(told.standing, told.stood_s)


def _unknown(region: _Region, why: Why) -> RegionValues:
    return RegionValues(region.camera.id, region.roi.id, why=why, limit_mm=_limit(region.roi))


def _limit(roi: RoiConfig) -> float | None:
    return None if roi.calibration is None else roi.calibration.limit_mm


def _with_lumps(told: RegionValues, state: StateMessage, ago_s: float) -> RegionValues:
    """The values with what is seen on the belt; `ago_s` is how long ago the state came."""
    counted = [found for found in state.objects if found.counts]
    sizes = [found.size for found in counted if found.size is not None]
    largest = [size.longest_mm for size in sizes if size.longest_mm is not None]
    first = min((s for s in sizes if s.lip_s is not None), key=lambda s: s.lip_s or 0.0, default=None)
    age_s = ago_s + (0.0 if state.timing is None else state.timing.age_s)
    return replace(
        told,
        existence=state.existence,
        count=len(counted),
        largest_mm=max(largest, default=None),
        lip_s=None if first is None or first.lip_s is None else max(0.0, first.lip_s - age_s),
        speed_mm_s=None if first is None else 1000.0 * first.speed_m_s,
    )


def _with(region: RegionValues, counter: int) -> RegionValues:
    return replace(region, heartbeat=counter)
