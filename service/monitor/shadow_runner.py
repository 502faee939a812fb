"""The shadows of one camera in a running monitor: run behind the decisions, published on the bus, kept on the disk."""

from __future__ import annotations

import logging
from collections.abc import Callable

from lumpwatch.service.bus import Bus, Keys, Publisher
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Clocks, RoiResult, utc
from lumpwatch.service.detection import Shadows
from lumpwatch.service.monitor.artifacts import NewShadow
from lumpwatch.service.storage import PriorStore, StateKeeper
from lumpwatch.service.telemetry import ShadowMetrics

log = logging.getLogger(__name__)

KEEP_EVERY_S = 5.0
"""How often what was counted is written to the store; a monitor that is killed loses as much."""


class ShadowRunner:
    """Used by the monitor's main loop, behind the decisions."""

    def __init__(
        self,
        *,
        site: str,
        camera: CameraConfig,
        store: PriorStore,
        bus: Bus,
        metrics: ShadowMetrics,
        clocks: Callable[[], Clocks],
    ) -> None:
        self._keys = Keys(site)
        self._camera = camera
        self._bus = bus
        self._shadows = Shadows(camera, lambda: utc(clocks().wall_s), lambda: clocks().monotonic_s, metrics)
        self._keeper = StateKeeper(store)
        self._publishers: dict[str, Publisher] = {}
        self._rois: set[str] = set()
        self._kept_s = float("-inf")

    def follow(self, results: tuple[RoiResult, ...], spent_s: float) -> None:
        """Show the shadows a frame that was decided and announced, which took `spent_s`."""
        self._shadows.follow(results, spent_s)

    def publish(self, now_s: float) -> None:
        """Publish the state of each shadow, and keep it every few seconds."""
        keep = now_s - self._kept_s >= KEEP_EVERY_S
        for roi in sorted(self._rois):
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
        for roi in sorted(self._rois):
            if (state := self._shadows.state(roi)) is not None:
                self._keeper.keep(state)
        self._keeper.close()

    def take(self, found: NewShadow, current: int) -> None:
        """Run a shadow that was newly set beside version `current`, or end one that was removed."""
        roi, prior = found.roi, found.prior
        self._rois.add(roi)
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
        self._shadows.use(roi, prior, current, found.kept)
