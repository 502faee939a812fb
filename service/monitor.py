"""The monitor process of one camera: frames from the bus -> pipeline -> states, alarms, heartbeat."""

from __future__ import annotations

import json
import logging
import threading
import time
from dataclasses import replace
from multiprocessing.connection import Connection

from prometheus_client import CollectorRegistry

from service.bus.bus import Bus
from service.bus.errors import BusClosed
from service.bus.keys import Keys
from service.bus.messages import Handler, Publisher
from service.bus.session import open_client
from service.config import SiteConfig
from service.errors import LumpwatchError
from service.frames import Frame
from service.link import WorkerLink
from service.logs import log_to_stderr
from service.messages import Heartbeat, RoiBeat, utc
from service.pipeline import CameraPipeline, RoiResult
from service.prior_watch import PriorWatch
from service.report import Clocks, alarm_event, state_message
from service.sources.timing import StreamClock
from service.store.prior import encode
from service.store.priors import PriorStore
from service.telemetry.metrics import MonitorMetrics

log = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
HEARTBEAT_VALID_S = 3.0
LOOK_EVERY_S = 0.25
"""How often states are decided and published while no frame comes."""


def run_monitor(config: SiteConfig, camera_id: str, connection: Connection) -> None:
    """Filter and decide until told to stop; the entry point of the process."""
    log_to_stderr()
    registry = CollectorRegistry()
    link = WorkerLink(connection, registry)
    camera = config.camera(camera_id)
    metrics = MonitorMetrics(registry, camera_id, tuple(roi.id for roi in camera.rois))
    try:
        with open_client(config.bus, link.stop) as bus:
            Monitor(config, camera_id, bus, link, metrics).run()
    except BusClosed:
        pass  # told to stop before the hub was there
    finally:
        link.close()


class Monitor:
    """One camera's monitor; `run` is its main loop."""

    def __init__(
        self, config: SiteConfig, camera_id: str, bus: Bus, link: WorkerLink, metrics: MonitorMetrics
    ) -> None:
        self._site = config.site
        self._camera = config.camera(camera_id)
        self._bus = bus
        self._link = link
        self._metrics = metrics
        self._lock = threading.Lock()  # acknowledgements arrive in threads of the bus
        self._priors = PriorWatch(
            PriorStore(config.store.path, config.store.keep_priors), camera_id, config.store.poll_s, metrics
        )
        self._pipeline = CameraPipeline(
            self._camera, {roi.id: self._priors.first(roi.id) for roi in self._camera.rois}, metrics
        )
        self._keys = Keys(config.site)
        self._inbox = bus.frame_inbox(self._keys.frame(camera_id))
        self._heartbeat = bus.publisher(self._keys.heartbeat(camera_id))
        self._states: dict[str, Publisher] = {}
        self._alarms: dict[str, Publisher] = {}
        for roi in self._camera.rois:
            self._states[roi.id] = bus.publisher(self._keys.state(camera_id, roi.id))
            self._alarms[roi.id] = bus.alarm_publisher(self._keys.alarm(camera_id, roi.id))
        self._decisions: dict[str, RoiResult] = {}
        self._decided_s: dict[str, float] = {}
        self._far_clock = StreamClock()  # of a camera process on another host
        self._told_skipped = 0
        self._told_malformed: dict[str, int] = {}
        self._alarm_number = 0
        self._beats = 0

    def run(self) -> None:
        """Until the link says stop."""
        self._publish(self._pipeline.look(time.monotonic()))
        for roi in self._camera.rois:
            self._bus.serve(self._keys.ack(self._camera.id, roi.id), self._acknowledger(roi.id))
            self._bus.serve(self._keys.prior(self._camera.id, roi.id), self._prior_reader(roi.id))
        self._bus.alive(self._keys.alive("monitor", self._camera.id))
        self._link.state = "running"
        looked_s = beat_s = 0.0
        while not self._link.stop.is_set():
            self._link.beat()
            frame = self._take()
            now = time.monotonic()
            with self._lock:
                if frame is not None:
                    try:
                        self._publish(self._pipeline.process(frame, now))
                    except LumpwatchError as error:
                        log.error("%s", error)  # noqa: TRY400 - the line says it all
                        self._metrics.dropped("unfit")
                        frame = None
                if frame is None and now - looked_s >= LOOK_EVERY_S:
                    self._publish(self._pipeline.look(now))
                    looked_s = now
                if now - beat_s >= HEARTBEAT_S:
                    self._send_heartbeat(now)
                    self._count_inbox()
                    self._look_for_priors(now)
                    beat_s = now

    def _take(self) -> Frame | None:
        """The newest frame, with its times on the clock of this host."""
        frame = self._inbox.take(LOOK_EVERY_S)
        if frame is None or self._inbox.same_clock:
            return frame
        arrived = time.monotonic()
        received = self._far_clock.stamp(frame.received_s, arrived).capture_s
        return replace(frame, received_s=received, capture_s=received - (frame.received_s - frame.capture_s))

    def _publish(self, results: tuple[RoiResult, ...]) -> None:
        for result in results:
            now = time.monotonic()
            clocks = Clocks(now, time.time())
            if result.transition is not None:
                self._send_alarm(result, clocks)
            message = state_message(result, self._site, self._camera.id, clocks)
            self._states[result.roi].put(message.line())
            self._metrics.state(result.roi, result.decision, result.existence, result.alarm.state)
            if result.decided and result.frame is not None and result.detection is not None:
                self._decided_s[result.roi] = self._link.decided[result.roi] = now
                self._metrics.decided(
                    result.roi,
                    now - result.frame.received_s,
                    result.detection,
                )
            self._tell_change(result)
            self._decisions[result.roi] = result

    def _send_alarm(self, result: RoiResult, clocks: Clocks) -> None:
        transition = result.transition
        assert transition is not None
        self._alarm_number += 1
        event = alarm_event(result, self._site, self._camera.id, self._alarm_number, clocks)
        self._alarms[result.roi].put(event.line())
        self._metrics.transition(result.roi, transition)
        log.warning(
            "%s/%s: alarm %s (existence %.2f, frame %d)",
            self._camera.id,
            result.roi,
            transition.change.value,
            result.existence,
            event.data.frame,
        )

    def _tell_change(self, result: RoiResult) -> None:
        before = self._decisions.get(result.roi)
        if before is None or before.decision is not result.decision:
            reason = f" ({result.reason.value})" if result.reason else ""
            log.info("%s/%s: %s%s", self._camera.id, result.roi, result.decision.value, reason)

    def _send_heartbeat(self, now: float) -> None:
        self._beats += 1
        rois = {}
        for roi, result in self._decisions.items():
            decided = self._decided_s.get(roi)
            ago = None if decided is None else round(now - decided, 3)
            rois[roi] = RoiBeat(state=result.decision, decided_ago_s=ago)
        beat = Heartbeat(
            site=self._site,
            camera=self._camera.id,
            seq=self._beats,
            time=utc(time.time()),
            valid_s=HEARTBEAT_VALID_S,
            rois=rois,
        )
        self._heartbeat.put(beat.line())

    def _count_inbox(self) -> None:
        if (skipped := self._inbox.skipped - self._told_skipped) > 0:
            self._metrics.dropped("skipped", skipped)
            self._told_skipped += skipped
        for reason, count in dict(self._inbox.malformed).items():
            new = count - self._told_malformed.get(reason, 0)
            if new > 0:
                self._metrics.dropped(f"malformed_{reason}", new)
                self._told_malformed[reason] = count

    def _look_for_priors(self, now: float) -> None:
        for roi in self._camera.rois:
            if (prior := self._priors.look(roi.id, now)) is not None:
                self._pipeline.use_prior(roi.id, prior)
            self._priors.measure(roi.id, self._pipeline.prior(roi.id), time.time())

    def _acknowledger(self, roi: str) -> Handler:
        def acknowledge(parameters: dict[str, str], payload: bytes | None) -> bytes:
            actor = parameters.get("actor", "").strip()[:128]
            if not actor:
                raise ValueError("say who acknowledges: …/ack?actor=NAME")
            now = time.monotonic()
            with self._lock:
                result = self._pipeline.acknowledge(roi, actor, now)
                self._publish((result,))
            done = result.transition is not None
            return json.dumps({"acknowledged": done, "alarm": result.alarm.state.value}).encode()

        return acknowledge

    def _prior_reader(self, roi: str) -> Handler:
        def read(parameters: dict[str, str], payload: bytes | None) -> bytes:
            with self._lock:
                prior = self._pipeline.prior(roi)
            if prior is None:
                raise ValueError(f"roi {roi} runs on the stated defaults, it has no prior")
            return encode(prior)

        return read
