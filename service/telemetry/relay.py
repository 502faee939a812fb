"""The metrics of worker processes, shown by the daemon as if they were one.

Each worker sends the text of its registry once a second; the newest text of each is parsed by the
client library when Prometheus scrapes. Counters of a worker that was started again go on from where
its predecessor last reported.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator

from prometheus_client.metrics_core import Metric
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import Collector

_Key = tuple[str, str, tuple[tuple[str, str], ...]]
_CUMULATIVE = ("counter", "histogram", "summary")


class Relay(Collector):
    """Collects what the workers sent; safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._texts: dict[str, str] = {}
        self._silent: set[str] = set()
        self._totals: dict[_Key, float] = {}

    def update(self, worker: str, text: str) -> None:
        """The newest text of a worker."""
        with self._lock:
            self._texts[worker] = text
            self._silent.discard(worker)

    def silent(self, worker: str) -> None:
        """A worker does not report for now: show what it counted, but no gauge as if it were still so."""
        with self._lock:
            self._silent.add(worker)

    def gone(self, worker: str) -> None:
        """A worker has ended: keep what it counted, forget its gauges."""
        with self._lock:
            self._silent.discard(worker)
            text = self._texts.pop(worker, "")
            for family in text_string_to_metric_families(text):
                if family.type in _CUMULATIVE:
                    for key, value in _samples(family):
                        self._totals[key] = self._totals.get(key, 0.0) + value

    def collect(self) -> Iterable[Metric]:
        """All families, each once, with the samples of all workers."""
        with self._lock:
            texts = [(text, worker in self._silent) for worker, text in self._texts.items()]
            values = dict(self._totals)
        families: dict[str, Metric] = {}
        present: dict[_Key, float] = {}
        for text, silent in texts:
            for family in text_string_to_metric_families(text):
                if family.name.endswith("_created") or (silent and family.type not in _CUMULATIVE):
                    continue
                families.setdefault(family.name, Metric(family.name, family.documentation, family.type))
                for key, value in _samples(family):
                    present[key] = present.get(key, 0.0) + value
        for key, value in values.items():
            present[key] = present.get(key, 0.0) + value
        for (name, sample, labels), value in sorted(present.items(), key=_order):
            if name in families:  # a family that no living worker knows comes back with its worker
                families[name].add_sample(sample, dict(labels), value)
        return families.values()

    def describe(self) -> Iterable[Metric]:
        """Nothing is known before the workers report."""
        return []


def _samples(family: Metric) -> Iterator[tuple[_Key, float]]:
    for sample in family.samples:
        if not sample.name.endswith("_created"):
            yield (family.name, sample.name, tuple(sorted(sample.labels.items()))), sample.value


def _order(item: tuple[_Key, float]) -> tuple[str, tuple[tuple[str, str], ...], str, float]:
    """Samples of one series together, histogram buckets by rising bound."""
    (name, sample, labels), _ = item
    bound = float(dict(labels).get("le", "inf"))
    return name, tuple(pair for pair in labels if pair[0] != "le"), sample, bound
