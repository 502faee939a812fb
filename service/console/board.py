"""What the bus says now, kept as it came and put together only when somebody looks.

Messages arrive in threads of the bus; a callback stores them and counts up, no more. Times are those of this
process' monotonic clock: `heard` is when a heartbeat came, so a reader can tell how old it is.
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pydantic import ValidationError

from lumpwatch.service.bus import Bus, Keys
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.ages import Ages
from lumpwatch.service.core import AlarmClass, Change
from lumpwatch.service.protocol import AlarmEvent, Heartbeat, StateMessage

CURVE_S, CURVE_STEP_S = 120.0, 0.2
"""How much of the existence is kept, and how densely."""
UNKNOWN = "UNKNOWN"
"""The state of an alarm of which nothing was heard since the console was started."""
_RECORDS = 500
_FRAMES = 90
_FRAME = re.compile(rb'"frame": ?(\d{1,15})[,}]')
_AGE = re.compile(rb'"age_s": ?(\d{1,9}\.?\d{0,25})[,}]')
_AGED_EVERY_S = 0.5
_EXISTENCE = re.compile(rb'"existence": ?(\d\.?\d{0,25}(?:[eE]-?\d{1,3})?)[,}]')


class _Region:
    """What is kept of one region."""

    def __init__(self) -> None:
        self.state: bytes | None = None
        self.came_s = 0.0
        self.decided: deque[tuple[int, bytes]] = deque(maxlen=_FRAMES)
        self.curve: deque[tuple[float, float]] = deque(maxlen=round(CURVE_S / CURVE_STEP_S))
        self.last: dict[AlarmClass, AlarmEvent] = {}
        self.raised: dict[AlarmClass, AlarmEvent] = {}
        self.ages = Ages()
        self.aged_s = -1.0


class Board:
    """The latest of everything on the bus of a site."""

    def __init__(
        self,
        config: SiteConfig,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self.config = config
        self._clock = clock
        self._wall = wall
        self._keys = Keys(config.site)
        self._lock = threading.Lock()
        self._regions = {(camera.id, roi.id): _Region() for camera in config.cameras for roi in camera.rois}
        self._heartbeats: dict[str, tuple[dict[str, Any], float]] = {}
        self._records: deque[AlarmEvent] = deque(maxlen=_RECORDS)
        self.version = 0
        """Counts what has come."""
        self.alarm_version = 0
        """Counts alarm records."""
        self.missed = 0
        """Alarm records that could not be had any more."""
        self.malformed = 0
        """Messages that were not understood."""

    def follow(self, bus: Bus) -> None:
        """Subscribe to what is shown."""
        bus.subscribe(self._keys.states(), self.on_state, history=True)
        bus.subscribe(self._keys.heartbeats(), self.on_heartbeat, history=True)
        bus.subscribe_alarms(self._keys.alarms(), self.on_alarm, self.on_missed)

    def on_state(self, key: str, payload: bytes) -> None:
        """A state has come; it is not taken apart before somebody asks."""
        region = self._regions.get(self._region_of(key))
        if region is None:
            return  # of a daemon with other cameras
        now, frame, existence = self._clock(), _FRAME.search(payload), _EXISTENCE.search(payload)
        with self._lock:
            region.state, region.came_s = payload, now
            if frame and (not region.decided or region.decided[-1][0] != int(frame[1])):
                region.decided.append((int(frame[1]), payload))
            if existence and (not region.curve or now - region.curve[-1][0] >= CURVE_STEP_S):
                region.curve.append((now, float(existence[1])))
            self.version += 1
        if now - region.aged_s >= _AGED_EVERY_S and (age := _AGE.search(payload)):
            region.aged_s = now
            region.ages.add(float(age[1]), self._wall())

    def on_heartbeat(self, key: str, payload: bytes) -> None:
        """A heartbeat has come. A last value that the bus had kept does not count: nobody knows its age."""
        try:
            beat = Heartbeat.model_validate_json(payload)
        except ValidationError:
            self.malformed += 1
            return
        with self._lock:
            known = self._heartbeats.get(beat.camera)
            heard = json.loads(beat.line())
            if known is None:
                # The first may be one that the bus kept of a monitor that is dead: it counts from the next one on.
                self._heartbeats[beat.camera] = (heard, -1e9)
            elif known[0]["seq"] != beat.seq or known[0]["time"] != heard["time"]:
                self._heartbeats[beat.camera] = (heard, self._clock())
            self.version += 1

    def on_alarm(self, key: str, payload: bytes) -> None:
        """An alarm record has come, each once and in order."""
        try:
            event = AlarmEvent.model_validate_json(payload)
        except ValidationError:
            self.malformed += 1
            return
        region = self._regions.get((event.data.camera, event.data.roi))
        with self._lock:
            self._records.append(event)
            if region is not None:
                region.last[event.data.alarm_class] = event
                if event.data.change is Change.RAISED:
                    region.raised[event.data.alarm_class] = event
            self.version += 1
            self.alarm_version += 1

    def on_missed(self, count: int) -> None:
        """Some records could not be had."""
        self.missed += count

    def age(self, where: tuple[str, str], hour: int, share: float) -> float | None:
        """Age that this share of a region's decisions in an hour (since the epoch) did not exceed, seconds."""
        return self._regions[where].ages.percentile(hour, share)

    def snapshot(self) -> dict[str, Any]:
        """Everything that pages show, as plain data."""
        with self._lock:
            now = self._clock()
            beats = dict(self._heartbeats)
            regions = {
                where: (region.state, region.came_s, dict(region.last), dict(region.raised))
                for where, region in self._regions.items()
            }
        return {
            "site": self.config.site,
            "now_s": now,
            "alarm_version": self.alarm_version,
            "missed": self.missed,
            "cameras": {camera.id: self._camera(beats.get(camera.id), now) for camera in self.config.cameras},
            "regions": [
                self._shown(where, *kept, beats.get(where[0]), now) for where, kept in regions.items()
            ],
        }

    def decided_on(self, camera: str) -> dict[int, dict[str, bytes]]:
        """By frame number: the state of each region that was decided on it, oldest first."""
        found: dict[int, dict[str, bytes]] = {}
        with self._lock:
            for (of, roi), region in self._regions.items():
                if of == camera:
                    for frame, payload in region.decided:
                        found.setdefault(frame, {})[roi] = payload
        return found

    def curve(self, camera: str, roi: str) -> list[tuple[float, float]]:
        """Existence over the last two minutes: seconds ago, probability. KeyError for what is not watched."""
        region = self._regions[camera, roi]
        with self._lock:
            now = self._clock()
            return [(round(now - at, 2), value) for at, value in region.curve if now - at <= CURVE_S]

    def records(self) -> list[dict[str, Any]]:
        """The latest alarm records, newest first."""
        with self._lock:
            kept = list(self._records)
        return [json.loads(event.line()) for event in reversed(kept)]

    def _region_of(self, key: str) -> tuple[str, str]:
        parts = key.split("/")
        return (parts[-3], parts[-2]) if len(parts) >= 3 else ("", "")

    def _camera(self, beat: tuple[dict[str, Any], float] | None, now: float) -> dict[str, Any]:
        if beat is None or beat[1] < 0:
            return {"heard_ago_s": None, "valid_s": None, "valid": False}
        return {
            "heard_ago_s": round(now - beat[1], 3),
            "valid_s": beat[0]["valid_s"],
            "valid": beat[0]["valid"],
            "time": beat[0]["time"],
            "rois": {roi: one["valid"] for roi, one in beat[0]["rois"].items()},
        }

    def _shown(
        self,
        where: tuple[str, str],
        state: bytes | None,
        came_s: float,
        last: dict[AlarmClass, AlarmEvent],
        raised: dict[AlarmClass, AlarmEvent],
        beat: tuple[dict[str, Any], float] | None,
        now: float,
    ) -> dict[str, Any]:
        told: dict[str, Any] = {}
        if state is not None:
            try:
                told = json.loads(StateMessage.model_validate_json(state).line())
            except ValidationError:
                self.malformed += 1
        stands = told.get("alarms") or {}
        unsaid = "NORMAL" if told else UNKNOWN  # a monitor may not know every class
        alarms = [
            self._alarm(alarm_class, stands.get(alarm_class, unsaid), last, raised)
            for alarm_class in AlarmClass
        ]
        return {
            "camera": where[0],
            "roi": where[1],
            "status": self._status(where, told, beat, now),
            "state": told,
            "came_ago_s": round(now - came_s, 3) if state is not None else None,
            "alarms": alarms,
        }

    def _status(
        self,
        where: tuple[str, str],
        told: dict[str, Any],
        beat: tuple[dict[str, Any], float] | None,
        now: float,
    ) -> str:
        """CLEAR, LUMP, BLIND, or SILENT where nothing valid was heard: silence is never clear."""
        if not told or beat is None or now - beat[1] > beat[0]["valid_s"] or not beat[0]["valid"]:
            return "SILENT"
        region = beat[0]["rois"].get(where[1])
        return str(told["state"]) if region is not None and region["valid"] else "SILENT"

    def _alarm(
        self,
        alarm_class: AlarmClass,
        stands: str,
        last: dict[AlarmClass, AlarmEvent],
        raised: dict[AlarmClass, AlarmEvent],
    ) -> dict[str, Any]:
        found: dict[str, Any] = {"class": alarm_class.value, "state": stands, "last": None, "raised": None}
        for name, among in (("last", last), ("raised", raised)):
            if (event := among.get(alarm_class)) is not None:
                data = event.data
                largest = max(
                    (o.size.longest_mm or 0.0 for o in data.objects if o.size is not None), default=0.0
                )
                found[name] = {
                    "time": event.time.isoformat(),
                    "change": data.change.value,
                    "priority": data.priority,
                    "sequence": data.sequence,
                    "existence": data.existence,
                    "actor": data.actor,
                    "reason": data.reason,
                    "until": data.until.isoformat() if data.until else None,
                    "evidence": data.evidence,
                    "left_s": data.left_s,
                    "longest_mm": largest or None,
                    "id": event.id,
                }
        return found
