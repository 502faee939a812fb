"""Metrics of a mouth: how much stands in it, and for how long."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Gauge

if TYPE_CHECKING:
    from lumpwatch.service.protocol import BlockageRecord


class MouthMetrics:
    """One camera's; part of `MonitorMetrics`. Regions that watch a belt have none."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        self._camera = camera

        def gauge(name: str, text: str) -> Gauge:
            return Gauge(name, text, ("camera", "roi"), registry=registry)

        self._standing = gauge(
            "lumpwatch_mouth_standing_ratio",
            "Share of the mouth in which material stands still; NaN: not known, or the region is blind.",
        )
        self._stood = gauge(
            "lumpwatch_mouth_stood_seconds",
            "For how long enough of it has stood while the feed ran; NaN: not known, or the region is blind.",
        )

    def update(self, roi: str, blockage: BlockageRecord | None, *, mouth: bool, blind: bool) -> None:
        """What is known of a ROI's mouth; `mouth`: whether it watches one."""
        if not mouth:
            return
        known = None if blind else blockage
        for gauge, value in (
            (self._standing, None if known is None else known.standing),
            (self._stood, None if known is None else known.stood_s),
        ):
            gauge.labels(self._camera, roi).set(math.nan if value is None else value)
