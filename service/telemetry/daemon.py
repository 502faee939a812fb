"""The metrics of the daemon itself."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from prometheus_client import CollectorRegistry, Counter, Gauge, ProcessCollector

from lumpwatch.service.telemetry.certificates import CertificateMetrics


class DaemonMetrics:
    """Metrics of the daemon itself."""

    def __init__(
        self,
        registry: CollectorRegistry,
        version: str,
        store: Path,
        certificates: Mapping[str, Path] = MappingProxyType({}),
    ) -> None:
        """`store` is the folder whose disk is watched, `certificates` are the files whose end is told."""
        CertificateMetrics(registry, certificates)
        ProcessCollector(registry=registry)  # process_*: the daemon's own
        Gauge(
            "lumpwatch_store_free_ratio", "Share of the store's disk that is free.", registry=registry
        ).set_function(lambda: _free(store))
        Gauge("lumpwatch_build_info", "Version of lumpwatch.", ("version",), registry=registry).labels(
            version
        ).set(1)
        self._restarts = Counter(
            "lumpwatch_worker_restarts",
            "Worker processes that were started again; process is hub, camera or monitor, reason exited or stuck.",
            ("camera", "process", "reason"),
            registry=registry,
        )

    def watched(self, camera: str, process: str) -> None:
        """A worker process is watched: its first restart is to be seen as a rise from 0."""
        for reason in ("exited", "stuck"):
            self._restarts.labels(camera, process, reason)

    def restarted(self, camera: str, process: str, reason: str) -> None:
        """A worker process is started again."""
        self._restarts.labels(camera, process, reason).inc()


def _free(folder: Path) -> float:
    """Share of the disk under the folder, or under the nearest one that exists, that is free to us."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        disk = os.statvfs(folder)
    except OSError:
        return 0.0  # a disk that does not answer has no room
    return disk.f_bavail / disk.f_blocks if disk.f_blocks else 0.0
