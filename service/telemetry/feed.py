"""Metrics of the feed: what it does, how fast, and how full the belt is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, Gauge

from lumpwatch.service.core import FeedState

if TYPE_CHECKING:
    from lumpwatch.service.protocol import FeedRecord


class FeedMetrics:
    """One camera's; part of `MonitorMetrics`. What is not known is NaN."""

    def __init__(self, registry: CollectorRegistry, camera: str) -> None:
        self._camera = camera

        def gauge(name: str, text: str, *labels: str) -> Gauge:
            return Gauge(name, text, ("camera", "roi", *labels), registry=registry)

        self._state = gauge("lumpwatch_feed_state", "1 for what the feed does, 0 for all others.", "state")
        self._speed = gauge(
            "lumpwatch_feed_speed_meters_per_second", "Speed of the belt towards the lip; NaN: not known."
        )
        self._pixels = gauge(
            "lumpwatch_feed_speed_pixels_per_second", "Speed in the picture; NaN: not known."
        )
        self._load = gauge("lumpwatch_feed_load_ratio", "Share of the belt that is covered; NaN: not known.")
        self._agrees = gauge(
            "lumpwatch_feed_signal_agrees",
            "1 while the plant's signal agrees with what is seen, 0 while not; NaN: nothing to compare.",
        )
        self._size = gauge(
            "lumpwatch_visible_size_meters",
            "Size that this share of the visible stones' area lies below, a trend; NaN: not known.",
            "quantile",
        )

    def update(self, roi: str, feed: FeedRecord | None) -> None:
        """What is known of a ROI's feed; None where it is not looked at."""
        if feed is None:
            return
        for state in FeedState:
            self._state.labels(self._camera, roi, state.value).set(state is feed.state)
        for gauge, value in (
            (self._speed, _meters(feed.speed_mm_s)),
            (self._pixels, feed.speed_px_s),
            (self._load, feed.load),
            (self._agrees, feed.agrees),
        ):
            gauge.labels(self._camera, roi).set(math.nan if value is None else value)
        for quantile, size in (("0.5", feed.visible_p50_mm), ("0.8", feed.visible_p80_mm)):
            metres = _meters(size)
            self._size.labels(self._camera, roi, quantile).set(math.nan if metres is None else metres)


def _meters(millimetres: float | None) -> float | None:
    return None if millimetres is None else millimetres / 1000.0
