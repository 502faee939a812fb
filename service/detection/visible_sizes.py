"""How coarse the feed looks on a calibrated belt: P50 and P80 of the stones that are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.feed import SizeTrend
from lumpwatch.models.likelihood.maps import LEFT, LOWER, PROBABILITY, RIGHT, UPPER
from lumpwatch.models.likelihood.net import STRIDE
from lumpwatch.models.plane import equivalent_mm, ground_of
from lumpwatch.models.roi import Roi
from lumpwatch.service.belt import make_plane
from lumpwatch.service.config import CalibrationConfig, FeedConfig
from lumpwatch.service.core import VisibleSizes

_EVERY_S = 1.0
_BODY = 0.5
_ROUNDING_S = 1e-3


class SizeWatch:
    """Of one region; times rise from step to step."""

    def __init__(self, config: FeedConfig, calibration: CalibrationConfig, size: tuple[int, int]) -> None:
        """`size`: width and height of the pictures."""
        self._config, self._size = config, size
        self._plane = make_plane(calibration, *size)
        self._trend = SizeTrend(config.sizes_over_s)
        self._last_s = float("-inf")
        self._ground: tuple[Roi, NDArray[np.float64]] | None = None

    @property
    def sizes(self) -> VisibleSizes | None:
        """Of the stones that were seen lately; None as long as they are too few."""
        p50, p80 = self._trend.quantile(0.5), self._trend.quantile(0.8)
        if p50 is None or p80 is None or self._trend.stones < self._config.sizes_from:
            return None
        return VisibleSizes(p50, p80, int(self._trend.stones))

    def step(self, bodies: NDArray[np.float32], roi: Roi, time_s: float) -> None:
        """What the cells of a picture of a belt that runs say of their bodies (rows, columns, VOTES).

        `roi`: the region as the detector works with it.
        """
        if time_s < self._last_s + _EVERY_S - _ROUNDING_S:
            return
        self._last_s = time_s
        if self._ground is None or self._ground[0] is not roi:
            y, x = np.mgrid[: bodies.shape[0], : bodies.shape[1]] + 0.5
            cells = np.column_stack([x.ravel(), y.ravel()]) * STRIDE / roi.scale
            self._ground = roi, ground_of(self._plane, cells + np.array([roi.x, roi.y]))
        ground = self._ground[1]
        votes = bodies.reshape(-1, bodies.shape[2]).astype(float)
        low, high = votes[:, [LEFT, UPPER]], votes[:, [RIGHT, LOWER]]
        boxes = roi.to_frame(np.hstack([(low + high) / 2.0, np.maximum(high - low, 0.0)]))
        whole = (boxes[:, :2] > 1.0).all(axis=1) & (
            boxes[:, :2] + boxes[:, 2:] < np.array(self._size) - 1.0
        ).all(axis=1)
        told = (votes[:, PROBABILITY] >= _BODY) & whole & (ground > 0.0) & (boxes[:, 2:] > 0.0).all(axis=1)
        if not told.any():
            return
        boxes = boxes[told]
        centred = np.column_stack([boxes[:, :2] + boxes[:, 2:] / 2.0, boxes[:, 2:]])
        sizes = equivalent_mm(self._plane, centred)
        seen = np.isfinite(sizes)
        cell = (STRIDE / roi.scale) ** 2
        shares = cell / (0.25 * np.pi * boxes[:, 2] * boxes[:, 3])
        self._trend.add(sizes[seen], ground[told][seen], np.minimum(shares[seen], 1.0), time_s)
