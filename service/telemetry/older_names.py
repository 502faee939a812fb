"""Metrics under the names of 0.1, beside those that took their place, for one more release."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import MappingProxyType

from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector
from prometheus_client.samples import Sample


@dataclass(frozen=True, slots=True)
class Older:
    """One metric as it was."""

    name: str
    label: str = ""
    """The label of now that was called `was`; empty: all are called as before."""
    was: str = "reason"
    factor: float = 1.0
    """Old units in one of the new."""
    age: bool = False
    """Whether it told how long ago something was, where the new one tells when."""


OLDER = MappingProxyType(
    {
        "lumpwatch_largest_meters": Older("lumpwatch_largest_mm", factor=1000.0),
        "lumpwatch_visible_size_meters": Older("lumpwatch_visible_size_mm", factor=1000.0),
        "lumpwatch_feed_speed_meters_per_second": Older("lumpwatch_feed_speed_mm_per_second", factor=1000.0),
        "lumpwatch_feed_speed_pixels_per_second": Older("lumpwatch_feed_speed_px_per_second"),
        "lumpwatch_camera_shift_pixels": Older("lumpwatch_camera_shift_px"),
        "lumpwatch_prior_created_timestamp_seconds": Older("lumpwatch_prior_age_seconds", age=True),
        "lumpwatch_proof_test_timestamp_seconds": Older("lumpwatch_proof_test_age_seconds", age=True),
        "lumpwatch_alarm_changes": Older("lumpwatch_alarm_transitions", "change"),
        "lumpwatch_proof_test_outcomes": Older("lumpwatch_proof_tests", "outcome"),
        "lumpwatch_commands_refused": Older("lumpwatch_requests_refused", "command"),
        "lumpwatch_worker_restarts": Older("lumpwatch_process_restarts", "process", "stage"),
        "lumpwatch_shadow_agreement_seconds": Older("lumpwatch_shadow_compared_seconds", "side"),
        "lumpwatch_shadow_raised_alarms": Older("lumpwatch_shadow_alarms", "side"),
        "lumpwatch_shadow_judged_frames": Older("lumpwatch_shadow_frames", "outcome"),
    }
)
"""By the name of now, counters without `_total`."""


class WithOlderNames(Collector):
    """All that a collector has, and once more under its older name what has got another."""

    def __init__(self, collector: Collector, clock: Callable[[], float] = time.time) -> None:
        """`clock` tells the wall time in seconds."""
        self._collector, self._clock = collector, clock

    def collect(self) -> Iterator[Metric]:
        """Each family once."""
        for family in self._collector.collect():
            yield family
            if (older := OLDER.get(family.name)) is not None:
                yield self._as_before(family, older)

    def describe(self) -> Iterable[Metric]:
        """Nothing is known beforehand."""
        return []

    def _as_before(self, family: Metric, older: Older) -> Metric:
        before = Metric(older.name, f"Older name of {family.name}, for one more release.", family.type)
        for sample in family.samples:
            if sample.name.endswith("_created"):
                continue
            labels = {
                older.was if name == older.label else name: value for name, value in sample.labels.items()
            }
            value = self._clock() - sample.value if older.age else sample.value * older.factor
            name = older.name + sample.name.removeprefix(family.name)
            before.samples.append(Sample(name, labels, value))
        return before
