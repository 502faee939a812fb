"""Tells the world what the pipeline of one camera decided: event log, alarms, states, levels, metrics.

An alarm record is in the event log before it is on the bus, as far as the disk allows (see
`lumpwatch.service.storage.event_log_writer`), and a record that was in the log but perhaps not on the bus when the
process ended is sent again, with the same sequence number. While there is no hub nothing is on the bus.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from lumpwatch.service.bus import Bus, Keys, Message, Publisher
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import AlarmChange, AlarmClass, Change, Clocks, RoiResult
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.monitor.heartbeat import VALID_S
from lumpwatch.service.monitor.largest_seen import LargestSeen
from lumpwatch.service.monitor.latency import LatencyWatch
from lumpwatch.service.monitor.uptime import WatchLog
from lumpwatch.service.protocol import AlarmData, alarm_event, level_of, record_id, state_message
from lumpwatch.service.storage import Details, Entry, Event, EventWriter, Span
from lumpwatch.service.telemetry import MonitorMetrics

log = logging.getLogger(__name__)

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
        record: Callable[[Trigger], bool] = lambda _: False,
    ) -> None:
        """`clock` names this host's monotonic clock, `clocks` tells the time, `record` begins evidence."""
        self._site = site
        self._bus = bus
        self._linked = False
        self._unconfirmed: list[tuple[str, str]] = []
        self._camera = camera.id
        self._events = events
        self._metrics = metrics
        self._clock = clock
        self._clocks = clocks
        self._record = record
        self._watch = WatchLog()
        self._largest = {roi.id: LargestSeen() for roi in camera.rois}
        self._states: dict[str, Publisher] = {}
        self._alarms: dict[str, Publisher] = {}
        self._levels: dict[str, Publisher] = {}
        self._latency = {roi.id: LatencyWatch(camera.latency) for roi in camera.rois}
        self._level_sent: dict[str, tuple[bytes, float]] = {}
        keys = Keys(site)
        for roi in camera.rois:
            self._states[roi.id] = bus.publisher(keys.state(camera.id, roi.id))
            self._levels[roi.id] = bus.publisher(keys.level(camera.id, roi.id))
            key = keys.alarm(camera.id, roi.id)
            self._alarms[roi.id] = bus.alarm_publisher(key, self._past(roi.id, key))
        self._sequences = {roi.id: 0 for roi in camera.rois} | events.sequences()

    def sequence(self, roi: str) -> int:
        """That of the ROI's last alarm record."""
        return self._sequences[roi]

    def late(self, roi: str) -> bool:
        """Whether the ROI's decisions have used up their latency budget for too long."""
        return self._latency[roi].exhausted(self._clocks().monotonic_s)

    def send_again(self) -> None:
        """What the last process may not have brought onto the bus."""
        past = {(one.roi, one.id): one for one in self._events.records}
        for roi, number, record in self._events.unpublished:
            if roi in self._alarms:
                known = past.get((roi, number))
                if known is None or not known.publisher:
                    self._alarms[roi].put(record)
                else:  # under the old name: who has had it does not get it twice
                    self._alarms[roi].put(record, known.number, known.publisher)
        self._sent([(roi, number) for roi, number, _ in self._events.unpublished])

    def confirm(self) -> None:
        """Called once a second: what was sent without a hub is fetched by subscribers soon after it is back."""
        linked = self._bus.linked
        if linked and self._linked and self._unconfirmed:
            self._events.published(self._unconfirmed)
            self._unconfirmed = []
        self._linked = linked

    def _sent(self, records: list[tuple[str, str]]) -> None:
        """These (ROI, id) were put; where a hub is there, they are on the bus."""
        if not records:
            return
        if self._bus.linked:
            self._events.published(records)
        else:
            self._linked = False
            self._unconfirmed += records

    def _past(self, roi: str, key: str) -> list[Message]:
        """What former processes have sent."""
        waiting = {(where, number) for where, number, _ in self._events.unpublished}
        return [
            Message(key, one.record, one.publisher, one.number)
            for one in self._events.records
            if one.roi == roi and one.publisher and (roi, one.id) not in waiting
        ]

    def announce(self, results: tuple[RoiResult, ...]) -> None:
        """Write and send the changes, then the states."""
        clocks = self._clocks()
        for result in results:
            self._largest[result.roi].saw(result)
            if result.decided:
                self._time(result, clocks.monotonic_s)
        entries = [entry for result in results for entry in self._entries(result, clocks)]
        if entries:
            self._events.write(entries)
            for entry in entries:
                self._alarms[entry.event.roi].put(entry.record, entry.event.sequence)
            self._sent([(entry.event.roi, entry.event.id) for entry in entries])
        for result in results:
            sequence = self._sequences[result.roi]
            message = state_message(result, self._site, self._camera, clocks, sequence)
            self._states[result.roi].put(message.line())
            self._send_level(result.roi, level_of(result, sequence, VALID_S).line(), clocks.monotonic_s)
            self._metrics.state(result.roi, result.decision, result.existence, result.alarms)
            self._write_spans(self._watch.saw(result.roi, result.reason, clocks))

        took_s = self._clocks().monotonic_s - clocks.monotonic_s
        for result in results:
            if result.decided:
                self._latency[result.roi].published(took_s)

    def _time(self, result: RoiResult, now_s: float) -> None:
        watch = self._latency[result.roi]
        watch.decided(result, now_s)
        if watch.last is not None:
            self._metrics.latency(result.roi, watch.last)

    def close(self) -> None:
        """Nobody watches any more."""
        self._write_spans(self._watch.close(self._clocks()))

    def _write_spans(self, spans: tuple[Span, ...]) -> None:
        if spans:
            self._events.add(spans, wait=False)

    def _begin_evidence(self, result: RoiResult, change: AlarmChange, clocks: Clocks) -> str | None:
        """The id of the evidence of an alarm that was raised, where there will be one."""
        sequence = self._sequences[result.roi]
        name = record_id(clocks, sequence)
        trigger = Trigger(name, result.roi, change.alarm_class, sequence, clocks.wall_s, clocks.monotonic_s)
        raised = change.transition.change is Change.RAISED
        return name if raised and self._record(trigger) else None

    def _entries(self, result: RoiResult, clocks: Clocks) -> list[Entry]:
        entries = []
        for change in result.changes:
            self._sequences[result.roi] += 1
            sequence, told = self._sequences[result.roi], change.transition
            made = alarm_event(
                result,
                change,
                self._site,
                self._camera,
                sequence,
                clocks,
                latency=self._latency[result.roi].last,
                evidence=self._begin_evidence(result, change, clocks),
            )
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
                self._details(made.data),
            )
            entries.append(Entry(event, made.line(), self._alarms[result.roi].name))
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

    def _details(self, data: AlarmData) -> Details:
        """What reports want to know of a change beside the alarm's own columns."""
        found: Details = {"lip_s": data.lip_s, "evidence": data.evidence}
        if data.alarm_class is AlarmClass.LUMP:
            found |= self._largest[data.roi].told()
        return {name: value for name, value in found.items() if value is not None}

    def _send_level(self, roi: str, line: bytes, now_s: float) -> None:
        sent, sent_s = self._level_sent.get(roi, (b"", 0.0))
        if line != sent or now_s - sent_s >= LEVEL_EVERY_S:
            self._levels[roi].put(line)
            self._level_sent[roi] = (line, now_s)
