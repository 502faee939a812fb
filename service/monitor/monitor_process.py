"""The monitor process of one camera: frames from the bus -> pipeline -> states, alarms, heartbeat."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection

from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import Bus, BusClosed, Callback, Handler, Keys, Kind, host_clock, open_client
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import (
    AlarmRequestError,
    Change,
    Clocks,
    Frame,
    RoiResult,
    StreamClock,
    Trouble,
    log_to_stderr,
)
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import EvidenceKeeper
from lumpwatch.service.monitor.announcer import Announcer
from lumpwatch.service.monitor.heartbeat import LastDecision, heartbeat
from lumpwatch.service.monitor.prior_watch import PriorWatch
from lumpwatch.service.monitor.proof.chain import ProofTest, Site
from lumpwatch.service.monitor.proof.keeper import ProofKeeper
from lumpwatch.service.monitor.reference_watch import ReferenceWatch
from lumpwatch.service.monitor.shadow_desk import ShadowDesk
from lumpwatch.service.monitor.verdict_handler import verdict_handler
from lumpwatch.service.protocol import ActReply, act_of, read
from lumpwatch.service.storage import (
    EventWriter,
    Prior,
    PriorStore,
    ReferenceStore,
    Retention,
    encode_prior,
    event_file,
)
from lumpwatch.service.telemetry import MonitorMetrics, ProofMetrics, WorkerLink

log = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
LOOK_EVERY_S = 0.25
"""How often states are decided and published while no frame comes."""


def run_monitor(config: SiteConfig, camera_id: str, connection: Connection) -> None:
    """Filter and decide until told to stop; the entry point of the process."""
    log_to_stderr()
    registry = CollectorRegistry()
    link = WorkerLink(connection, registry)
    camera = config.camera(camera_id)
    rois = tuple(roi.id for roi in camera.rois)
    metrics, proofs = MonitorMetrics(registry, camera_id, rois), ProofMetrics(registry, camera_id, rois)
    retention = Retention(config.store.keep_events_days, config.store.keep_events)
    events = EventWriter(config.store.path, camera_id, metrics, time.time, retention=retention)
    evidence = EvidenceKeeper(config, camera_id, metrics)
    try:
        with open_client(config.bus, link.stop) as bus:
            Monitor(config, camera_id, bus, link, metrics, events, evidence, proofs).run()
    except BusClosed:
        pass  # told to stop before the hub was there
    finally:
        events.close()  # first: it matters more, and the time is limited
        evidence.close()
        link.close()


class Monitor:
    """One camera's monitor; `run` is its main loop."""

    def __init__(
        self,
        config: SiteConfig,
        camera_id: str,
        bus: Bus,
        link: WorkerLink,
        metrics: MonitorMetrics,
        events: EventWriter,
        evidence: EvidenceKeeper,
        proofs: ProofMetrics,
    ) -> None:
        self._site = config.site
        self._camera = config.camera(camera_id)
        self._bus = bus
        self._link = link
        self._metrics = metrics
        self._events = events
        self._event_file = event_file(config.store.path, camera_id)
        self._evidence = evidence
        self._lock = threading.Lock()  # what operators and the plant ask arrives in threads of the bus
        store = PriorStore(config.store.path, config.store.keep_priors)
        self._priors = PriorWatch(store, camera_id, config.store.poll_s, metrics)
        references = ReferenceStore(config.store.path, config.store.keep_priors)
        self._references = ReferenceWatch(references, camera_id, config.store.poll_s, metrics.picture)
        self._pipeline = CameraPipeline(
            self._camera,
            {roi.id: self._priors.first(roi.id) for roi in self._camera.rois},
            observer=metrics,
            alarms=events.alarms(time.monotonic(), time.time(), host_clock()),
            reference=self._references.look(time.monotonic()),
        )
        self._keys = Keys(config.site)
        self._inbox = bus.frame_inbox(self._keys.frame(camera_id))
        self._heartbeat = bus.publisher(self._keys.heartbeat(camera_id))
        clocks = lambda: Clocks(time.monotonic(), time.time())  # noqa: E731
        test = ProofTest(config.site, self._camera, bus, self._watched())
        self._proofs = ProofKeeper(self._camera, config.store.path, test.run, proofs, clocks)
        self._announcer = Announcer(
            config.site,
            self._camera,
            bus,
            events,
            metrics,
            host_clock(),
            clocks,
            evidence.begin,
        )
        self._shadows = ShadowDesk(
            config.site, self._camera, store, config.store.poll_s, bus, metrics.shadows
        )
        self._decisions: dict[str, RoiResult] = {}
        self._decided_s: dict[str, float] = {}
        self._far_clock = StreamClock()  # of a camera process on another host
        self._told_skipped = 0
        self._told_malformed: dict[str, int] = {}
        self._beats = 0

    def run(self) -> None:
        """Until the link says stop."""
        self._announcer.send_again()
        self._tell_troubles()
        self._publish(self._pipeline.look(time.monotonic()))
        for roi in self._camera.rois:
            self._serve(roi.id)
        self._bus.alive(self._keys.alive("monitor", self._camera.id))
        looked_s = beat_s = 0.0
        while not self._link.stop.is_set():
            self._link.beat()
            frame = self._take()
            now = time.monotonic()
            results: tuple[RoiResult, ...] = ()
            with self._lock:
                if frame is not None:
                    try:
                        self._evidence.before(frame, self._pipeline)
                        results = self._pipeline.process(frame, now)
                        self._evidence.after(frame, now, results)
                        self._link.state = "running"  # kernels are compiled in the first step
                        self._publish(results)
                        if not results:
                            frame = None  # one that is not newer does not keep the picture alive
                    except LumpwatchError as error:
                        log.error("%s", error)  # noqa: TRY400 - the line says it all
                        self._metrics.dropped("unfit")
                        frame = None
                if frame is None and now - looked_s >= LOOK_EVERY_S:
                    self._publish(self._pipeline.look(now))
                    self._evidence.tick(now)
                    looked_s = now
                if now - beat_s >= HEARTBEAT_S:
                    self._send_heartbeat(now)
                    self._announcer.confirm()
                    self._count_inbox()
                    self._look_for_priors(now)
                    self._proofs.look()
                    self._tell_troubles()
                    beat_s = now
            # Behind everything else and outside the lock: what a shadow does can only be late.
            self._shadows.follow(results, time.monotonic() - now)
        with self._lock:
            self._announcer.close()
        self._shadows.close()

    def _serve(self, roi: str) -> None:
        """Answer operators, the plant, and whoever wants the prior."""
        keys = {
            Kind.ACK: self._keys.ack,
            Kind.RESET: self._keys.reset,
            Kind.SHELVE: self._keys.shelve,
            Kind.UNSHELVE: self._keys.unshelve,
            Kind.SERVICE: self._keys.service,
            Kind.SUPPRESS: self._keys.suppress,
        }
        for kind, key in keys.items():
            self._bus.serve(key(self._camera.id, roi), self._act(kind, roi))
        self._bus.subscribe(self._keys.suppress(self._camera.id, roi), self._suppressor(roi))
        self._bus.serve(self._keys.prior(self._camera.id, roi), self._prior_reader(roi))
        self._bus.serve(self._keys.evidence(self._camera.id, roi), self._evidence.handler(roi))
        refused = partial(self._metrics.refused, roi, Kind.VERDICT.value)
        judging = verdict_handler(self._event_file, roi, self._events, time.time, refused)
        self._bus.serve(self._keys.verdict(self._camera.id, roi), judging)
        self._bus.serve(self._keys.proof(self._camera.id, roi), partial(self._proofs.request, roi))

    def _watched(self) -> Site:
        """What a proof test may know of this chain."""

        def prior(roi: str) -> Prior | None:
            with self._lock:
                return self._pipeline.prior(roi)

        return Site(
            size=lambda: self._pipeline.size,
            prior=prior,
            decision=lambda roi: self._decisions[roi].decision,
            stopped=self._link.stop.wait,
        )

    def _tell_troubles(self) -> None:
        for roi in self._camera.rois:
            for trouble, present in self._proofs.troubles(roi.id).items():
                self._pipeline.trouble(roi.id, trouble, present=present)

    def _take(self) -> Frame | None:
        """The newest frame, with its times on the clock of this host."""
        frame = self._inbox.take(LOOK_EVERY_S)
        if frame is None or self._inbox.same_clock:
            return frame
        arrived = time.monotonic()
        received = self._far_clock.stamp(frame.received_s, arrived).capture_s
        return replace(frame, received_s=received, capture_s=received - (frame.received_s - frame.capture_s))

    def _publish(self, results: tuple[RoiResult, ...]) -> None:
        self._announcer.announce(results)
        for result in results:
            if result.decided and result.frame is not None and result.detection is not None:
                now = time.monotonic()
                self._decided_s[result.roi] = self._link.decided[result.roi] = now
                self._metrics.decided(result.roi, now - result.frame.received_s, result.detection)
                self._pipeline.trouble(result.roi, Trouble.LATENCY, present=self._announcer.late(result.roi))
            self._metrics.picture.judged(result.roi, result.reason, result.quality)
            self._tell_change(result)
            self._decisions[result.roi] = result

    def _tell_change(self, result: RoiResult) -> None:
        before = self._decisions.get(result.roi)
        if before is None or before.decision is not result.decision:
            reason = f" ({result.reason.value})" if result.reason else ""
            log.info("%s/%s: %s%s", self._camera.id, result.roi, result.decision.value, reason)

    def _send_heartbeat(self, now: float) -> None:
        self._beats += 1
        rois = {
            roi: LastDecision(result.decision, self._decided_s.get(roi))
            for roi, result in self._decisions.items()
        }
        beat = heartbeat(
            self._site,
            self._camera.id,
            self._beats,
            rois,
            self._camera.blind_after_s,
            Clocks(now, time.time()),
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
            if (found := self._priors.look(roi.id, now)) is not None:
                self._pipeline.use_prior(roi.id, found.prior)
                self._evidence.restart()  # a clip is to be replayed with one prior
            self._priors.measure(roi.id, self._pipeline.prior(roi.id), time.time())
        self._shadows.look(self._pipeline.prior, now)
        self._shadows.tell(now)
        if (reference := self._references.look(now)) is not None:
            self._pipeline.use_reference(reference)
        used, mount = self._pipeline.reference, self._pipeline.quality.mount
        self._metrics.picture.mounted(used.version if used else 0, mount.shift_px, mount.follows)

    def _act(self, kind: Kind, roi: str) -> Handler:
        def handle(parameters: dict[str, str], payload: bytes | None) -> bytes:
            try:
                alarm_class, act = act_of(kind, read(parameters, payload))
                with self._lock:
                    result = self._pipeline.act(roi, alarm_class, act, time.monotonic())
                    self._publish((result,))
                    sequence = self._announcer.sequence(roi)
            except AlarmRequestError:
                self._metrics.refused(roi, kind.value)
                raise
            changes = [one.transition.change for one in result.changes if one.alarm_class is alarm_class]
            alarm = result.alarms[alarm_class]
            return ActReply(
                alarm_class=alarm_class,
                changes=tuple(changes),
                alarm=alarm.state,
                active=alarm.active,
                sequence=sequence,
                acknowledged=Change.ACKNOWLEDGED in changes if kind is Kind.ACK else None,
            ).line()

        return handle

    def _suppressor(self, roi: str) -> Callback:
        handle = self._act(Kind.SUPPRESS, roi)

        def put(key: str, payload: bytes) -> None:
            try:
                handle({}, payload)
            except AlarmRequestError as error:
                log.warning("%s: %s", key, error)

        return put

    def _prior_reader(self, roi: str) -> Handler:
        def read(parameters: dict[str, str], payload: bytes | None) -> bytes:
            with self._lock:
                prior = self._pipeline.prior(roi)
            if prior is None:
                raise ValueError(f"roi {roi} runs on the stated defaults, it has no prior")
            return encode_prior(prior)

        return read
