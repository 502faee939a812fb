"""Tells the world what the pipeline of one camera decided: event log, alarms, states, levels, metrics.

An alarm record is in the event log before it is on the bus, as far as the disk allows (see
`service.store.event_writer`), and a record that was in the log but perhaps not on the bus when the
process ended is sent again, with the same sequence number.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from service.alarms import AlarmClass
from service.bus.bus import Bus
from service.bus.keys import Keys
from service.bus.messages import Publisher
from service.config import CameraConfig
from service.pipeline import RoiResult
from service.report import Clocks, alarm_event, level, state_message
from service.store.event_writer import EventWriter
from service.store.events import Entry, Event
from service.telemetry.metrics import MonitorMetrics

log = logging.getLogger(__name__)

VALID_S = 3.0
"""Levels and heartbeats that are older say nothing any more."""
LEVEL_EVERY_S = 0.5
"""How often a level that has not changed is sent."""


class Announcer:
    """The publishers of one camera and its event log; used under the monitor's lock."""

    def __init__(
        self,
        site: str,
        camera: CameraConfig,
        bus: Bus,
        events: EventWriter,
        metrics: MonitorMetrics,
        clock: str,
        clocks: Callable[[], Clocks],
    ) -> None:
        """`clock` names this host's monotonic clock, `clocks` tells the time."""
        self._site = site
        self._camera = camera.id
        self._events = events
        self._metrics = metrics
        self._clock = clock
        self._clocks = clocks
        self._states: dict[str, Publisher] = {}
        self._alarms: dict[str, Publisher] = {}
        self._levels: dict[str, Publisher] = {}
        self._level_sent: dict[str, tuple[bytes, float]] = {}
        keys = Keys(site)
        for roi in camera.rois:
            self._states[roi.id] = bus.publisher(keys.state(camera.id, roi.id))
            self._levels[roi.id] = bus.publisher(keys.level(camera.id, roi.id))
            self._alarms[roi.id] = bus.alarm_publisher(keys.alarm(camera.id, roi.id))
        self._sequences = {roi.id: 0 for roi in camera.rois} | events.sequences()

    def sequence(self, roi: str) -> int:
        """That of the ROI's last alarm record."""
        return self._sequences[roi]

    def send_again(self) -> None:
        """What the last process may not have brought onto the bus."""
        for roi, _, record in self._events.unpublished:
            if roi in self._alarms:
                self._alarms[roi].put(record)
        if self._events.unpublished:
            self._events.published([(roi, number) for roi, number, _ in self._events.unpublished])

    def announce(self, results: tuple[RoiResult, ...]) -> None:
        """Write and send the changes, then the states."""
        clocks = self._clocks()
        entries = [entry for result in results for entry in self._entries(result, clocks)]
        if entries:
            self._events.write(entries)
            for entry in entries:
                self._alarms[entry.event.roi].put(entry.record)
            self._events.published([(entry.event.roi, entry.event.id) for entry in entries])
        for result in results:
            sequence = self._sequences[result.roi]
            message = state_message(result, self._site, self._camera, clocks, sequence)
            self._states[result.roi].put(message.line())
            self._send_level(result.roi, level(result, sequence, VALID_S).line(), clocks.monotonic_s)
            alarms = {AlarmClass.LUMP: result.alarm, AlarmClass.BLIND: result.blind_alarm}
            self._metrics.state(result.roi, result.decision, result.existence, alarms)

    def _entries(self, result: RoiResult, clocks: Clocks) -> list[Entry]:
        entries = []
        for change in result.changes:
            self._sequences[result.roi] += 1
            made = alarm_event(result, change, self._site, self._camera, self._sequences[result.roi], clocks)
            told = change.transition
            event = Event(
                clocks.wall_s,
                clocks.monotonic_s,
                self._clock,
                self._camera,
                result.roi,
                change.alarm_class,
                told.change.value,
                told.before.value,
                told.after.value,
                told.actor,
                told.reason,
                made.data.existence,
                made.data.frame,
                made.id,
                made.data.sequence,
                change.alarm,
            )
            entries.append(Entry(event, made.line()))
            self._metrics.transition(result.roi, change.alarm_class, told)
            log.warning(
                "%s/%s: %s alarm %s%s (existence %.2f, frame %d)",
                self._camera,
                result.roi,
                change.alarm_class.value,
                told.change.value,
                f" by {told.actor}" if told.actor else "",
                result.existence,
                made.data.frame,
            )
        return entries

    def _send_level(self, roi: str, line: bytes, now_s: float) -> None:
        sent, sent_s = self._level_sent.get(roi, (b"", 0.0))
        if line != sent or now_s - sent_s >= LEVEL_EVERY_S:
            self._levels[roi].put(line)
            self._level_sent[roi] = (line, now_s)
