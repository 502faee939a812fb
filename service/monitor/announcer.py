"""Publishes what the pipeline of one camera decided: event log, alarms, states, levels, metrics.

An alarm record is in the event log before it is on the bus, as far as the disk allows (see
`lumpwatch.service.storage.event_log_writer`), and a record that was in the log but perhaps not on the bus when the
process ended is sent again, with the same sequence number. While there is no hub nothing is on the bus.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol

from lumpwatch.service.bus import Bus, Keys, Message, Publisher
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import AlarmChange, AlarmClass, Change, Changed, Clocks, RoiResult
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.monitor.alarm_record import AlarmRecord, Source, finish
from lumpwatch.service.monitor.effects import Confirm, Count, Effect, KeepEvidence, Publish, Write, effects_of
from lumpwatch.service.monitor.largest_lump import LargestLump
from lumpwatch.service.monitor.latency import LatencyTracker
from lumpwatch.service.monitor.uptime import UptimeRecorder
from lumpwatch.service.protocol import VALID_S, level_of, state_message
from lumpwatch.service.storage import EventWriter, Span
from lumpwatch.service.telemetry import MonitorMetrics

log = logging.getLogger(__name__)

LEVEL_EVERY_S = 0.5
"""How often a level that has not changed is sent."""


class Evidence(Protocol):
    """Keeps evidence of alarms; implemented by `lumpwatch.service.evidence.EvidenceKeeper`."""

    def wants(self, trigger: Trigger) -> bool:
        """Whether there will be evidence of that alarm."""

    def begin(self, trigger: Trigger) -> bool:
        """The alarm was raised; whether there will be evidence of it."""


class NoEvidence:
    """Keeps none."""

    def wants(self, trigger: Trigger) -> bool:
        """No."""
        return False

    def begin(self, trigger: Trigger) -> bool:
        """No."""
        return False


class Announcer:
    """The publishers of one camera and its event log; used under the monitor's lock."""

    def __init__(
        self,
        *,
        site: str,
        camera: CameraConfig,
        bus: Bus,
        events: EventWriter,
        metrics: MonitorMetrics,
        clock: str,
        clocks: Callable[[], Clocks],
        evidence: Evidence | None = None,
    ) -> None:
        """`clock` names this host's monotonic clock, `clocks` reads the clocks."""
        self._site = site
        self._bus = bus
        self._connected = False
        self._unconfirmed: list[tuple[str, str]] = []
        self._camera = camera.id
        self._events = events
        self._metrics = metrics
        self._source = Source(site, camera.id, clock)
        self._clocks = clocks
        self._evidence: Evidence = evidence or NoEvidence()
        self._shown: set[tuple[str, AlarmClass]] = set()
        """Conditions that there is evidence of."""
        self._uptime = UptimeRecorder()
        self._rois = {roi.id: roi for roi in camera.rois}
        self._largest = {roi.id: LargestLump() for roi in camera.rois}
        self._states: dict[str, Publisher] = {}
        self._alarms: dict[str, Publisher] = {}
        self._levels: dict[str, Publisher] = {}
        self._latency = {roi.id: LatencyTracker(camera.latency) for roi in camera.rois}
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
        past = {(record.roi, record.id): record for record in self._events.records}
        for roi, number, record in self._events.unpublished:
            if roi in self._alarms:
                former = past.get((roi, number))
                if former is None or not former.publisher:
                    self._alarms[roi].put(record)
                else:  # under the old name: who has had it does not get it twice
                    self._alarms[roi].put(record, former.number, former.publisher)
        self._sent([(roi, number) for roi, number, _ in self._events.unpublished])

    def confirm(self) -> None:
        """Called once a second: what was sent without a hub is fetched by subscribers soon after it is back."""
        connected = self._bus.connected and self._bus.flushed
        if connected and self._connected and self._unconfirmed:
            self._events.published(self._unconfirmed)
            self._unconfirmed = []
        self._connected = connected

    def _sent(self, records: list[tuple[str, str]]) -> None:
        """These (ROI, id) were put; where a hub is there, and takes them, they are soon on the bus."""
        if not records:
            return
        if not self._bus.connected:
            self._connected = False
        elif self._bus.flushed:
            self._events.published(records)
            return
        self._unconfirmed += records

    def _past(self, roi: str, key: str) -> list[Message]:
        """What former processes have sent."""
        waiting = {(where, number) for where, number, _ in self._events.unpublished}
        return [
            Message(key, record.record, record.publisher, record.number)
            for record in self._events.records
            if record.roi == roi and record.publisher and (roi, record.id) not in waiting
        ]

    def announce(self, results: tuple[RoiResult, ...]) -> None:
        """Write and send the changes, then the states."""
        clocks = self._clocks()
        for result in results:
            self._largest[result.roi].observe(result)
            if result.decided:
                self._time(result, clocks.monotonic_s)
        for effect in self.plan(results, clocks):
            self._do(effect)
        for result in results:
            sequence = self._sequences[result.roi]
            message = state_message(result, self._site, self._camera, clocks, sequence)
            self._states[result.roi].put(message.line())
            self._send_level(result.roi, level_of(result, sequence, VALID_S).line(), clocks.monotonic_s)
            self._metrics.state(result.roi, result.decision, result.existence, result.alarms)
            self._write_spans(self._uptime.observe(result.roi, result.reason, clocks))

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
        """End the open spans of uptime."""
        self._write_spans(self._uptime.close(self._clocks()))

    def _write_spans(self, spans: tuple[Span, ...]) -> None:
        if spans:
            self._events.add(spans, wait=False)

    def plan(self, results: Iterable[RoiResult], clocks: Clocks) -> tuple[Effect, ...]:
        """What the changes in these results set off. Raises RecordError; nothing has happened then."""
        return effects_of([record for result in results for record in self._records(result, clocks)])

    def check(self, result: RoiResult, alarm_class: AlarmClass, changed: Changed) -> None:
        """Raises RecordError where what is about to become of an alarm cannot be recorded.

        `result` is the last one of the ROI, from before the change.
        """
        alarm, made = changed
        priority = self._rois[result.roi].alarm.of_class(alarm_class).priority
        changes = tuple(AlarmChange(alarm_class, transition, alarm, priority) for transition in made)
        self._records(replace(result, changes=changes), self._clocks())

    def _records(self, result: RoiResult, clocks: Clocks) -> list[AlarmRecord]:
        return [
            finish(
                result,
                change,
                source=self._source,
                sequence=sequence,
                clocks=clocks,
                publisher=self._alarms[result.roi].name,
                latency=self._latency[result.roi].last,
                largest_lump=self._largest[result.roi].details(),
                evidence=self._wants,
            )
            for sequence, change in enumerate(result.changes, self._sequences[result.roi] + 1)
        ]

    def _wants(self, trigger: Trigger) -> bool:
        """Whether there will be evidence: once of a condition, however often holds end and it is raised anew."""
        return (trigger.roi, trigger.alarm_class) not in self._shown and self._evidence.wants(trigger)

    def _do(self, effect: Effect) -> None:
        match effect:
            case KeepEvidence(trigger):
                of = (trigger.roi, trigger.alarm_class)
                if of not in self._shown and self._evidence.begin(trigger):
                    self._shown.add(of)
            case Write(entries):
                self._sequences |= {entry.event.roi: entry.event.sequence for entry in entries}
                self._events.write(entries)
            case Publish(entry):
                self._alarms[entry.event.roi].put(entry.record, entry.event.sequence)
            case Count(roi, alarm_class, transition, existence, frame):
                self._metrics.transition(roi, alarm_class, transition)
                if transition.change in (Change.CLEARED, Change.INACTIVE):
                    self._shown.discard((roi, alarm_class))
                actor = f" by {transition.actor}" if transition.actor else ""
                log.warning(
                    "%s/%s: %s alarm %s%s (existence %.2f, frame %d)",
                    self._camera,
                    roi,
                    alarm_class.value,
                    transition.change.value,
                    actor,
                    existence,
                    frame,
                )
            case Confirm(records):
                self._sent(list(records))

    def _send_level(self, roi: str, line: bytes, now_s: float) -> None:
        sent, sent_s = self._level_sent.get(roi, (b"", 0.0))
        if line != sent or now_s - sent_s >= LEVEL_EVERY_S:
            self._levels[roi].put(line)
            self._level_sent[roi] = (line, now_s)
