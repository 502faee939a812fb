"""What a worker process takes of the machine; the daemon itself has the client library's `process_*`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from prometheus_client import CollectorRegistry
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

_MEMORY = Path("/proc/self/statm")
_LABELS = ("camera", "process")


class ProcessMetrics(Collector):
    """Processor time, memory and start of this process."""

    def __init__(self, registry: CollectorRegistry, camera: str, process: str) -> None:
        self._values = (camera, process)
        self._began_s = time.time()
        registry.register(self)

    def collect(self) -> Iterator[Metric]:
        """As it is now; memory is left out where the system does not tell."""
        cpu = CounterMetricFamily(
            "lumpwatch_process_cpu_seconds", "Processor time that a worker process has taken.", labels=_LABELS
        )
        used = os.times()
        cpu.add_metric(self._values, used.user + used.system)
        yield cpu
        memory = GaugeMetricFamily(
            "lumpwatch_process_resident_memory_bytes",
            "Memory of a worker process that is in RAM; what processes share counts in each.",
            labels=_LABELS,
        )
        if has := resident_bytes():
            memory.add_metric(self._values, has)
        yield memory
        began = GaugeMetricFamily(
            "lumpwatch_process_start_timestamp_seconds", "When a worker process began.", labels=_LABELS
        )
        began.add_metric(self._values, self._began_s)
        yield began

    def describe(self) -> Iterable[Metric]:
        """Nothing is known beforehand."""
        return []


def resident_bytes(statm: Path = _MEMORY) -> int:
    """Bytes that this process has in memory; 0 where the system does not tell."""
    try:
        return int(statm.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0
