"""Looks for a new reference of one camera while the daemon runs."""

from __future__ import annotations

import logging

from lumpwatch.service.storage import Reference, ReferenceStore, StoreError
from lumpwatch.service.telemetry import PictureMetrics

log = logging.getLogger(__name__)


class ReferenceWatch:
    """The reference of one camera in the store, looked at again every few seconds."""

    def __init__(self, store: ReferenceStore, camera: str, poll_s: float, metrics: PictureMetrics) -> None:
        self._store = store
        self._camera = camera
        self._poll_s = poll_s
        self._metrics = metrics
        self._looked_s = float("-inf")
        self._pointer: int | None = None

    def look(self, now_s: float) -> Reference | None:
        """A reference that has newly been set to be used, else None; reads at most once in `poll_s`."""
        if now_s - self._looked_s < self._poll_s:
            return None
        self._looked_s = now_s
        pointer = self._store.versions(self._camera).pointer
        if pointer is None or pointer == self._pointer:
            return None
        self._pointer = pointer
        try:
            found = self._store.current(self._camera)
        except StoreError as error:
            log.error("%s: %s", self._camera, error)  # noqa: TRY400 - the line says it all
            self._metrics.refused("unreadable")
            return None
        for problem in found.problems:
            log.error("%s: reference refused: %s", self._camera, problem)
            self._metrics.refused("unreadable")
        if found.reference is not None:
            log.info("%s: uses reference version %d", self._camera, found.reference.version)
        return found.reference
