"""Metrics that have got another name go on under the older one, with the values that it had."""

from __future__ import annotations

from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.telemetry.camera import CameraMetrics
from lumpwatch.service.telemetry.daemon import DaemonMetrics
from lumpwatch.service.telemetry.monitor import MonitorMetrics
from lumpwatch.service.telemetry.older_names import OLDER, WithOlderNames
from lumpwatch.service.telemetry.process import ProcessMetrics
from lumpwatch.service.telemetry.proof import ProofMetrics

NOW_S = 1000.0


def exposed(registry: CollectorRegistry) -> dict[tuple[str, ...], float]:
    return {
        (sample.name, *(f"{name}={value}" for name, value in sorted(sample.labels.items()))): sample.value
        for family in WithOlderNames(registry, lambda: NOW_S).collect()
        for sample in family.samples
    }


def test_units_labels_and_ages_as_before() -> None:
    registry = CollectorRegistry()
    Gauge("lumpwatch_largest_meters", "", ("roi",), registry=registry).labels("a").set(0.75)
    Gauge("lumpwatch_prior_created_timestamp_seconds", "", registry=registry).set(900.0)
    changes = Counter("lumpwatch_alarm_changes", "", ("class", "change"), registry=registry)
    changes.labels("lump", "raised").inc(3)
    Gauge("lumpwatch_objects", "", registry=registry).set(2)
    found = exposed(registry)
    assert found["lumpwatch_largest_meters", "roi=a"] == 0.75
    assert found["lumpwatch_largest_mm", "roi=a"] == 750.0
    assert found[("lumpwatch_prior_age_seconds",)] == 100.0
    assert found["lumpwatch_alarm_changes_total", "change=raised", "class=lump"] == 3.0
    assert found["lumpwatch_alarm_transitions_total", "class=lump", "reason=raised"] == 3.0
    assert found[("lumpwatch_objects",)] == 2.0


def test_every_name_that_took_a_place_exists() -> None:
    """A table that names a metric which is gone would drop the older one without a word."""
    registries = [CollectorRegistry() for _ in range(3)]
    DaemonMetrics(registries[0], "0", Path())
    CameraMetrics(registries[1], "c")
    MonitorMetrics(registries[2], "c", ("r",))
    ProofMetrics(registries[2], "c", ("r",))
    families = {family.name: family for one in registries for family in one.collect()}
    assert set(OLDER) <= set(families)
    assert not {older.name for older in OLDER.values()} & set(families)


def test_what_a_process_takes() -> None:
    registry = CollectorRegistry()
    ProcessMetrics(registry, "cam", "monitor")
    before = exposed(registry)
    sum(i * i for i in range(300_000))
    after = exposed(registry)
    of = ("camera=cam", "process=monitor")
    cpu = ("lumpwatch_process_cpu_seconds_total", *of)
    assert after[cpu] > before[cpu] >= 0.0
    assert after["lumpwatch_process_resident_memory_bytes", *of] == pytest.approx(
        before["lumpwatch_process_resident_memory_bytes", *of], rel=0.5
    )
    assert after["lumpwatch_process_resident_memory_bytes", *of] > 10e6
