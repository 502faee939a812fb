"""The main loop of a monitor: takes frames, decides, announces, answers, and lets nothing else hold it up.

It reads no clock but the one that it is given, and knows the bus, the log and the daemon as what is handed to
it, so that tests drive it without a process.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable

from lumpwatch.service.bus import Bus, Keys
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmClass,
    Changed,
    Clocks,
    Decision,
    FeedState,
    Frame,
    PlantFeed,
    RoiResult,
    Rules,
    Trouble,
)
from lumpwatch.service.detection import CameraPipeline, Snapshot
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import EvidenceKeeper
from lumpwatch.service.monitor.announcer import Announcer
from lumpwatch.service.monitor.artifacts import ArtifactWatcher, NewPrior, NewReference, NewShadow
from lumpwatch.service.monitor.command_server import CommandServer
from lumpwatch.service.monitor.heartbeat import LastDecision, heartbeat
from lumpwatch.service.monitor.inbox import Inbox
from lumpwatch.service.monitor.proof.chain import Site
from lumpwatch.service.monitor.proofs import Proofs
from lumpwatch.service.monitor.rivals import Rivals
from lumpwatch.service.monitor.shadow_runner import ShadowRunner
from lumpwatch.service.monitor.verdict_handler import verdict_handler
from lumpwatch.service.protocol import (
    EvidenceRequest,
    FeedReply,
    FeedRequest,
    PriorRequest,
    ProofRequest,
    blockage_of,
    feed_of,
)
from lumpwatch.service.storage import (
    EventWriter,
    Prior,
    PriorStore,
    ReferenceStore,
    encode_prior,
    event_file,
)
from lumpwatch.service.telemetry import RESTARTS_WITHIN_S, DaemonConnection, MonitorMetrics

log = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
MANY_RESTARTS = 3
"""A monitor that is the fourth within ten minutes says so: each of them was blind while it started."""
POLL_EVERY_S = 0.25
"""How often states are decided and published while no frame comes."""


class Monitor:
    """One camera's monitor; `run` is its main loop."""

    def __init__(
        self,
        *,
        config: SiteConfig,
        camera_id: str,
        bus: Bus,
        daemon: DaemonConnection,
        metrics: MonitorMetrics,
        events: EventWriter,
        evidence: EvidenceKeeper,
        make_proofs: Callable[[Site], Proofs],
        clock: str,
        clocks: Callable[[], Clocks],
        priors: PriorStore | None = None,
    ) -> None:
        """`clock` names this host's monotonic clock, `clocks` reads the clocks.

        `priors` None: those of the configured store.
        """
        self._site = config.site
        self._camera = config.camera(camera_id)
        self._bus = bus
        self._daemon = daemon
        self._metrics = metrics
        self._events = events
        self._evidence = evidence
        self._clocks = clocks
        self._lock = threading.Lock()  # what operators and the plant ask arrives in threads of the bus
        self._rois = tuple(roi.id for roi in self._camera.rois)
        store = PriorStore(config.store.path, config.store.keep_priors) if priors is None else priors
        self._artifacts = ArtifactWatcher(
            camera=camera_id,
            rois=self._rois,
            priors=store,
            references=ReferenceStore(config.store.path, config.store.keep_priors),
            poll_s=config.store.poll_s,
            metrics=metrics,
        )
        found, at = self._artifacts.first(), clocks()
        self._began_s = at.monotonic_s
        used = {artifact.roi: artifact.prior for artifact in found if isinstance(artifact, NewPrior)}
        self._pipeline = CameraPipeline(
            self._camera,
            used,
            older={
                roi: before
                for roi, prior in used.items()
                if prior is not None and (before := store.before(camera_id, roi, prior.version)) is not None
            },
            observer=metrics,
            alarms=events.alarms(at.monotonic_s, at.wall_s, clock),
            reference=next(
                (artifact.reference for artifact in found if isinstance(artifact, NewReference)), None
            ),
        )
        self._shadows = ShadowRunner(
            site=config.site,
            camera=self._camera,
            store=store,
            bus=bus,
            metrics=metrics.shadows,
            clocks=clocks,
        )
        self._run_shadows(tuple(artifact for artifact in found if isinstance(artifact, NewShadow)))
        self._keys = Keys(config.site)
        self._inbox = Inbox(bus.frame_inbox(self._keys.frame(camera_id)), metrics.dropped, self._now)
        self._heartbeat = bus.publisher(self._keys.heartbeat(camera_id))
        self._rivals = Rivals(camera_id, self._now)
        self._proofs = make_proofs(self._proof_site())
        self._announcer = Announcer(
            site=config.site,
            camera=self._camera,
            bus=bus,
            events=events,
            metrics=metrics,
            clock=clock,
            clocks=clocks,
            evidence=evidence,
        )
        judge = verdict_handler(event_file(config.store.path, camera_id), events, lambda: clocks().wall_s)
        self._commands = CommandServer(
            alarms=self,
            others={
                "verdict": judge,
                "evidence": self._show_evidence,
                "prior": self._show_prior,
                "proof": self._run_proof,
                "feed": self._take_plant_feed,
            },
            refused=metrics.refused,
        )
        self._decisions: dict[str, RoiResult] = {}
        self._decided_s: dict[str, float] = {}
        self._beats = 0
        self._polled_s = self._beat_s = 0.0

    def run(self) -> None:
        """Until the daemon stops it."""
        self._announcer.send_again()
        self._update_troubles()
        self._publish(self._pipeline.poll(self._now()))
        self._commands.serve(self._bus, self._keys, self._camera.id, self._rois)
        self._bus.alive(self._keys.alive("monitor", self._camera.id))
        heartbeats = self._keys.heartbeat(self._camera.id)
        self._bus.subscribe_others(heartbeats, self._heartbeat.name, self._rivals.monitor)
        self._artifacts.start()
        while not self._daemon.stop.is_set():
            self._daemon.beat()
            frame = self._inbox.take(POLL_EVERY_S)
            now = self._now()
            with self._lock:
                self._adopt()
                results = self._decide(frame, now)
                if not results and now - self._polled_s >= POLL_EVERY_S:
                    self._publish(self._pipeline.poll(now))
                    self._evidence.tick(now)
                    self._polled_s = now
                if now - self._beat_s >= HEARTBEAT_S:
                    self._beat(now)
                    self._beat_s = now
            # Behind everything else and outside the lock: what a shadow does can only be late.
            self._shadows.follow(results, self._now() - now)
        self._artifacts.close()
        with self._lock:
            self._announcer.close()
        self._shadows.close()

    def apply(self, roi: str, alarm_class: AlarmClass, action: AlarmAction) -> tuple[RoiResult, int]:
        """Do something to an alarm now; the result, and the sequence of the ROI's last record.

        Raises AlarmRequestError where it is not allowed, or cannot be recorded; the alarm is as before then.
        """
        with self._lock:
            shown = self._decisions[roi]

            def recordable(alarm: Alarm, rules: Rules, time_s: float) -> Changed:
                changed = action(alarm, rules, time_s)
                self._announcer.check(shown, alarm_class, changed)
                return changed

            result = self._pipeline.apply(roi, alarm_class, recordable, self._now())
            self._publish((result,))
            return result, self._announcer.sequence(roi)

    def _now(self) -> float:
        return self._clocks().monotonic_s

    def _proof_site(self) -> Site:
        """What a proof test may know of this chain."""
        return Site(
            size=lambda: self._pipeline.size,
            prior=self._prior,
            decision=lambda roi: self._decisions[roi].decision,
            stopped=self._daemon.stop.wait,
            feed=self._feed,
            snapshot=self._snapshot,
        )

    def _feed(self, roi: str) -> FeedState:
        feed = self._decisions[roi].feed
        return FeedState.UNKNOWN if feed is None else feed.state

    def _snapshot(self, roi: str) -> Snapshot:
        with self._lock:
            return self._pipeline.snapshots()[roi]

    def _prior(self, roi: str) -> Prior | None:
        with self._lock:
            return self._pipeline.prior(roi)

    def _show_prior(self, roi: str, _: PriorRequest) -> bytes:
        prior = self._prior(roi)
        if prior is None:
            raise LumpwatchError(f"roi {roi} runs on the stated defaults, it has no prior")
        return encode_prior(prior)

    def _show_evidence(self, roi: str, request: EvidenceRequest) -> bytes:
        return self._evidence.handler(roi)(request)

    def _run_proof(self, roi: str, request: ProofRequest) -> bytes:
        return self._proofs.test(roi, request.actor).line()

    def _take_plant_feed(self, roi: str, request: FeedRequest) -> bytes:
        """Compare what is seen with the plant's signal for as long as that is valid."""
        said = None
        if request.valid_s > 0.0:
            until_s = self._now() + request.valid_s
            said = PlantFeed(request.signal, until_s, request.runs, request.speed_mm_s)
        with self._lock:
            self._pipeline.plant(roi, said)
        return FeedReply(taken=said is not None).line()

    def _decide(self, frame: Frame | None, now: float) -> tuple[RoiResult, ...]:
        """Filter and announce; nothing for a frame that is not newer, or that does not fit."""
        if frame is None:
            return ()
        try:
            self._evidence.before(frame, self._pipeline)
            results = self._pipeline.process(frame, now)
            self._evidence.after(frame, now, results)
            self._daemon.state = "running"  # kernels are compiled in the first step
            self._publish(results)
        except LumpwatchError as error:
            log.error("%s", error)  # noqa: TRY400 - the line says it all
            self._metrics.dropped("unfit")
            return ()
        return results

    def _publish(self, results: tuple[RoiResult, ...]) -> None:
        self._announcer.announce(results)
        for result in results:
            if result.decided and result.frame is not None and result.detection is not None:
                now = self._now()
                self._decided_s[result.roi] = self._daemon.decided[result.roi] = now
                self._metrics.decided(result.roi, now - result.frame.received_s, result.detection)
                self._pipeline.trouble(result.roi, Trouble.LATENCY, present=self._announcer.late(result.roi))
            self._metrics.picture.update(result.roi, result.reason, result.quality)
            self._metrics.feed.update(result.roi, feed_of(result))
            self._metrics.mouth.update(
                result.roi,
                blockage_of(result),
                mouth=self._camera.roi(result.roi).watches_mouth,
                blind=result.decision is Decision.BLIND,
            )
            self._log_change(result)
            self._decisions[result.roi] = result

    def _log_change(self, result: RoiResult) -> None:
        before = self._decisions.get(result.roi)
        if before is None or before.decision is not result.decision:
            reason = f" ({result.reason.value})" if result.reason else ""
            log.info("%s/%s: %s%s", self._camera.id, result.roi, result.decision.value, reason)

    def _adopt(self) -> None:
        """Use what was found in the store."""
        for found in self._artifacts.take():
            match found:
                case NewPrior(roi, prior):
                    self._pipeline.use_prior(roi, prior)
                    self._evidence.restart()  # a clip is to be replayed with one prior
                case NewReference(reference):
                    self._pipeline.use_reference(reference)
                case NewShadow():
                    self._run_shadows((found,))

    def _run_shadows(self, found: tuple[NewShadow, ...]) -> None:
        for shadow in found:
            used = self._pipeline.prior(shadow.roi)
            self._shadows.take(shadow, used.version if used else 0)

    def _beat(self, now: float) -> None:
        """Once a second."""
        self._send_heartbeat(now)
        self._announcer.confirm()
        self._inbox.count_losses()
        self._measure()
        self._shadows.publish(now)
        self._proofs.poll()
        self._update_troubles()

    def _send_heartbeat(self, now: float) -> None:
        self._beats += 1
        rois = {
            roi: LastDecision(result.decision, self._decided_s.get(roi))
            for roi, result in self._decisions.items()
        }
        clocks = Clocks(now, self._clocks().wall_s)
        beat = heartbeat(self._site, self._camera.id, self._beats, rois, self._camera.blind_after_s, clocks)
        self._heartbeat.put(beat.line())

    def _measure(self) -> None:
        """Put versions and times of what is in use into the metrics."""
        for roi in self._rois:
            prior = self._pipeline.prior(roi)
            created_s = math.nan if prior is None else prior.meta.created.timestamp()
            self._metrics.prior(roi, prior.version if prior else 0, created_s)
        used, shift = self._pipeline.reference, self._pipeline.quality.shift
        self._metrics.picture.shifted(used.version if used else 0, shift.shift_px, shift.follows)

    def _update_troubles(self) -> None:
        self._rivals.frames(self._inbox.foreign)
        of_camera = {
            **self._rivals.troubles(),
            Trouble.EVENT_LOG: self._events.trouble,
            Trouble.RESTARTS: self._restarts_often(),
        }
        for roi in self._rois:
            for trouble, present in (*self._proofs.troubles(roi).items(), *of_camera.items()):
                self._pipeline.trouble(roi, trouble, present=present)

    def _restarts_often(self) -> bool:
        """Whether monitors of this camera ended again and again, and this one has not yet held for long."""
        calm_s = self._clocks().monotonic_s - self._began_s
        return self._daemon.restarts >= MANY_RESTARTS and calm_s < RESTARTS_WITHIN_S
