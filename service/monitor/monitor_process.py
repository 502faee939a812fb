"""The monitor process of one camera: frames from the bus -> pipeline -> states, alarms, heartbeat."""

from __future__ import annotations

import time
from functools import partial
from multiprocessing.connection import Connection

from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import BusClosed, host_clock, open_client
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.core import Clocks, log_to_stderr
from lumpwatch.service.evidence import EvidenceKeeper
from lumpwatch.service.monitor.monitor import Monitor
from lumpwatch.service.monitor.proof.chain import ProofTest, Site
from lumpwatch.service.monitor.proof.keeper import ProofKeeper
from lumpwatch.service.monitor.proof.lumps import stored_lumps
from lumpwatch.service.monitor.proofs import Proofs
from lumpwatch.service.storage import EventWriter, PriorStore, Retention
from lumpwatch.service.telemetry import DaemonConnection, MonitorMetrics, ProofMetrics


def run_monitor(config: SiteConfig, camera_id: str, connection: Connection) -> None:
    """Filter and decide until told to stop; the entry point of the process."""
    log_to_stderr()
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    daemon.obey_signals()
    camera = config.camera(camera_id)
    rois = tuple(roi.id for roi in camera.rois)
    metrics, proofs = MonitorMetrics(registry, camera_id, rois), ProofMetrics(registry, camera_id, rois)
    retention = Retention(config.store.keep_events_days, config.store.keep_events)
    events = EventWriter(config.store.path, camera_id, metrics, time.time, retention=retention)
    evidence = EvidenceKeeper(config, camera_id, metrics)
    priors = PriorStore(config.store.path, config.store.keep_priors)
    try:
        with open_client(config.bus, daemon.stop) as bus:

            def make_proofs(watched: Site) -> Proofs:
                test = ProofTest(config.site, camera, bus, watched, partial(stored_lumps, priors, camera_id))
                return ProofKeeper(camera, config.store.path, test.run, proofs, now)

            Monitor(
                config=config,
                camera_id=camera_id,
                bus=bus,
                daemon=daemon,
                metrics=metrics,
                events=events,
                evidence=evidence,
                make_proofs=make_proofs,
                clock=host_clock(),
                clocks=now,
            ).run()
    except BusClosed:
        pass  # told to stop before the hub was there
    finally:
        events.close()  # first: it matters more, and the time is limited
        evidence.close()
        daemon.close()


def now() -> Clocks:
    """The present moment."""
    return Clocks(time.monotonic(), time.time())
