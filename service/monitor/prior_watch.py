"""Looks for new priors while the daemon runs."""

from __future__ import annotations

import logging

from lumpwatch.service.storage import Found, Prior, PriorStore, StoreError
from lumpwatch.service.telemetry import MonitorMetrics

log = logging.getLogger(__name__)


class PriorWatch:
    """The priors of one camera in the store, looked at again every few seconds."""

    def __init__(self, store: PriorStore, camera: str, poll_s: float, metrics: MonitorMetrics) -> None:
        self._store = store
        self._camera = camera
        self._poll_s = poll_s
        self._metrics = metrics
        self._looked_s: dict[str, float] = {}
        self._pointer: dict[str, int | None] = {}

    def first(self, roi: str) -> Prior | None:
        """The prior to start with; None: the stated defaults."""
        self._pointer[roi] = self._store.pointer(self._camera, roi)
        return self._read(roi).prior

    def look(self, roi: str, now_s: float) -> Found | None:
        """What has newly been set to be used, else None; reads at most once in `poll_s`.

        A prior, or none where that is what was asked for.
        """
        if now_s - self._looked_s.get(roi, float("-inf")) < self._poll_s:
            return None
        self._looked_s[roi] = now_s
        pointer = self._store.pointer(self._camera, roi)
        if pointer is None or pointer == self._pointer.get(roi):
            return None
        self._pointer[roi] = pointer
        found = self._read(roi)
        if pointer == 0:
            log.info("%s/%s: uses the stated defaults", self._camera, roi)
            return found
        return None if found.prior is None else found

    def measure(self, roi: str, prior: Prior | None, wall_s: float) -> None:
        """Put version and age of the prior in use into the metrics."""
        age = 0.0 if prior is None else max(0.0, wall_s - prior.meta.created.timestamp())
        self._metrics.prior(roi, prior.version if prior else 0, age)

    def _read(self, roi: str) -> Found:
        try:
            found = self._store.current(self._camera, roi)
        except StoreError as error:
            log.error("%s/%s: %s", self._camera, roi, error)  # noqa: TRY400 - the line says it all
            self._metrics.prior_refused(roi, "unreadable")
            return Found(None)
        for problem in found.problems:
            log.error("%s/%s: prior refused: %s", self._camera, roi, problem)
            self._metrics.prior_refused(roi, "unreadable")
        if found.prior is not None:
            log.info("%s/%s: uses prior version %d", self._camera, roi, found.prior.version)
        return found
