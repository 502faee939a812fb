"""The shadows of one camera in a running monitor: taken from the store, told on the bus, kept on the disk."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from lumpwatch.service.bus import Bus, Keys, Publisher
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import RoiResult, utc
from lumpwatch.service.detection import Shadows
from lumpwatch.service.storage import Prior, PriorStore, StateKeeper, StoreError, read_state
from lumpwatch.service.telemetry import ShadowMetrics

log = logging.getLogger(__name__)

KEEP_EVERY_S = 5.0
"""How often what was counted is written to the store; a monitor that is killed loses as much."""


class ShadowDesk:
    """Used by the monitor's main loop, behind the decisions."""

    def __init__(
        self,
        site: str,
        camera: CameraConfig,
        store: PriorStore,
        poll_s: float,
        bus: Bus,
        metrics: ShadowMetrics,
        wall: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._keys = Keys(site)
        self._camera = camera
        self._store = store
        self._poll_s = poll_s
        self._bus = bus
        self._metrics = metrics
        self._shadows = Shadows(camera, lambda: utc(wall()), clock, metrics)
        self._keeper = StateKeeper(store)
        self._publishers: dict[str, Publisher] = {}
        self._pointer: dict[str, int | None] = {}
        self._looked_s = self._kept_s = float("-inf")

    def follow(self, results: tuple[RoiResult, ...], spent_s: float) -> None:
        """Show the shadows a frame that was decided and announced, which took `spent_s`."""
        self._shadows.follow(results, spent_s)

    def look(self, in_use: Callable[[str], Prior | None], now_s: float) -> None:
        """Take shadows that were newly set, drop those that were removed; at most once in `poll_s`."""
        if now_s - self._looked_s < self._poll_s:
            return
        self._looked_s = now_s
        for roi in self._camera.rois:
            pointer = self._store.shadow_pointer(self._camera.id, roi.id)
            if pointer != self._pointer.get(roi.id):
                self._pointer[roi.id] = pointer
                prior = in_use(roi.id)
                self._take(roi.id, prior.version if prior else 0)

    def tell(self, now_s: float) -> None:
        """Publish the state of each shadow, and keep it every few seconds."""
        keep = now_s - self._kept_s >= KEEP_EVERY_S
        for roi in self._pointer:
            state = self._shadows.state(roi)
            if state is None:
                continue
            if roi not in self._publishers:
                self._publishers[roi] = self._bus.publisher(self._keys.shadow(self._camera.id, roi))
            self._publishers[roi].put(state.line())
            if keep:
                self._keeper.keep(state)
                self._kept_s = now_s

    def close(self) -> None:
        """Keep what was counted."""
        for roi in self._pointer:
            if (state := self._shadows.state(roi)) is not None:
                self._keeper.keep(state)
        self._keeper.close()

    def _take(self, roi: str, current: int) -> None:
        prior = self._read(roi)
        before = self._shadows.state(roi)
        if before is not None:
            self._keeper.keep(before)
        if prior is None:
            if before is not None:
                log.info("%s/%s: shadow version %d is no longer run", self._camera.id, roi, before.version)
            if (publisher := self._publishers.pop(roi, None)) is not None:
                publisher.close()
            self._shadows.use(roi, None)
            return
        log.info("%s/%s: runs version %d in shadow", self._camera.id, roi, prior.version)
        self._shadows.use(roi, prior, current, read_state(self._store, self._camera.id, roi))

    def _read(self, roi: str) -> Prior | None:
        try:
            found = self._store.shadow(self._camera.id, roi)
        except StoreError as error:
            log.error("%s/%s: %s", self._camera.id, roi, error)  # noqa: TRY400 - the line says it all
            self._metrics.shadow_failed(roi, "unreadable")
            return None
        for problem in found.problems:
            log.error("%s/%s: shadow refused: %s", self._camera.id, roi, problem)
            self._metrics.shadow_failed(roi, "unreadable")
        return found.prior
