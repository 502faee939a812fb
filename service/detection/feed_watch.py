"""What the feed of a region does: from its working pictures to running, stopped, empty or unknown.

It steps with the region, reads no clock and changes nothing that the lump alarm is judged by.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from statistics import median

import numpy as np

from lumpwatch.models.feed import CoverMeter, FeedMotion, TileFlow
from lumpwatch.models.plane import ground_of, towards_lip
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.belt import make_plane
from lumpwatch.service.config import CalibrationConfig, FeedConfig
from lumpwatch.service.core import FeedState, FeedStatus

_USUAL_SHARE, _SLOWEST_MM_S = 0.1, 30.0
_RESUMES = 1.5
"""What stands must move so much faster than the limit to count as running again."""
_SMOOTHED, _REMEMBERED_S = 3, 1.0
_ROUNDING_S = 1e-3
_CARRIES, _CARRIES_S = 3.0, 1.0
"""Material is known to show in a region where so many times `filled_above` was seen to move for so long: more than one
lump among fines that do not show."""


class FeedWatch:
    """The feed of one region in pictures of one size; times rise from step to step."""

    def __init__(
        self, config: FeedConfig, calibration: CalibrationConfig | None, roi: Roi, size: tuple[int, int]
    ) -> None:
        """`size`: width and height of the pictures. Raises ValueError where the region is too small for it."""
        self._config, self._roi = config, roi
        self._flow = TileFlow(roi.mask)
        mask = self._flow.reduced(roi.mask * np.uint8(255))
        slope = weight = None
        if calibration is not None:
            plane, factor = make_plane(calibration, *size), self._flow.reduction / roi.scale
            y, x = np.mgrid[: mask.shape[0], : mask.shape[1]] + 0.5
            pixels = np.column_stack([x.ravel(), y.ravel()]) * factor + (roi.x, roi.y)
            weight = ground_of(plane, pixels).reshape(mask.shape).astype(np.float32)
            left, slope = towards_lip(plane, self._flow.centres / roi.scale + (roi.x, roi.y))
            slope[~(np.nan_to_num(left, nan=-1.0) > 0.0)] = np.nan
            slope /= roi.scale
            if not np.isfinite(slope).all(axis=1).any() or not weight[mask > 0].any():
                slope = weight = None
        self._cover = CoverMeter(mask, weight)
        self._motion = FeedMotion(self._flow, self._cover, slope)
        self._calibrated = slope is not None
        self._slowest = self._limit(calibration if self._calibrated else None)
        self._compared_s = self._told_s = float("-inf")
        self._since_s: float | None = None
        self._next: tuple[FeedState, float] | None = None
        self._speeds: deque[tuple[float, float, float, float]] = deque(maxlen=_SMOOTHED)
        """Of the last comparisons that told: when, along x and y in working px/s, and on the belt in mm/s."""
        self._carries_since_s: float | None = None
        self._shows = False
        """Whether material is known to show here: else a smooth picture may be a bare belt or a belt full of fines."""
        self._loads: deque[float] = deque(maxlen=_SMOOTHED)
        self.status = FeedStatus()
        """What is known now, but for what the plant says."""

    def step(self, gray: Image, time_s: float) -> None:
        """The next working picture (h, w)."""
        reduced = self._flow.reduced(gray)
        self._motion.add(reduced, time_s)
        if time_s < self._compared_s + 1.0 / self._config.rate_hz - _ROUNDING_S:
            return
        self._compared_s = time_s
        self._loads.append(self._cover.covered(reduced, self._config.bare_below))
        state = self._seen(time_s)
        if state is not None:
            self._told_s = time_s
            self._enter(state, time_s)
        elif time_s - self._told_s > self._config.unknown_after_s:
            self._become(FeedState.UNKNOWN, time_s)
        self._learn(time_s)
        self._tell()

    def _learn(self, time_s: float) -> None:
        """Texture that stands may be the picture's own; what is seen to run is material."""
        filled = self._config.filled_above
        runs = self.status.state is FeedState.RUNNING
        if not runs or median(self._loads) < min(_CARRIES * filled, 0.5 * (1.0 + filled)):
            self._carries_since_s = None
        elif self._carries_since_s is None:
            self._carries_since_s = time_s
        elif time_s - self._carries_since_s >= _CARRIES_S - _ROUNDING_S:
            self._shows = True

    def _limit(self, calibration: CalibrationConfig | None) -> float:
        """The slowest speed that counts as running: mm/s, without a calibration working px/s."""
        if calibration is None:
            return self._config.stopped_below * max(self._roi.shape)
        if self._config.stopped_below_mm_s is not None:
            return self._config.stopped_below_mm_s
        usual = calibration.speed_m_s
        return _SLOWEST_MM_S if usual is None else _USUAL_SHARE * 1000.0 * usual

    def _seen(self, time_s: float) -> FeedState | None:
        """What the newest pictures show; None where they tell nothing."""
        motion, before = self._motion.compare(self._config.bare_below), self.status.state
        if motion.velocity is not None:
            along = float("nan") if motion.along is None else motion.along
            self._speeds.append((time_s, *motion.velocity, along))
        while self._speeds and time_s - self._speeds[0][0] > _REMEMBERED_S:
            self._speeds.popleft()
        speed = self._speed() if motion.velocity is not None else None
        limit = self._config.filled_above if before is FeedState.EMPTY else self._config.empty_below
        if median(self._loads) < limit:
            return FeedState.EMPTY if self._shows else None
        if speed is None:
            return None
        slowest = self._slowest * (_RESUMES if before is FeedState.STOPPED else 1.0)
        if speed >= slowest:
            return FeedState.RUNNING
        return FeedState.STOPPED if motion.plain else None

    def _speed(self) -> float | None:
        """In units of the limit: a camera that shakes moves what stands to and fro."""
        if not self._speeds:
            return None
        _, x, y, along = (median(values) for values in zip(*self._speeds, strict=True))
        return abs(along) if self._calibrated else float(np.hypot(x, y))

    def _enter(self, state: FeedState, time_s: float) -> None:
        """Another state must be seen for a while."""
        if state is self.status.state:
            self._next = None
            return
        if self._next is None or self._next[0] is not state:
            self._next = (state, time_s)
        if time_s - self._next[1] >= self._config.delay_s - _ROUNDING_S:
            self._become(state, time_s)

    def _become(self, state: FeedState, time_s: float) -> None:
        if state is not self.status.state or self._since_s is None:
            self.status, self._since_s, self._next = replace(self.status, state=state), time_s, None

    def _tell(self) -> None:
        state = self.status.state
        along = px_s = None
        if state is FeedState.STOPPED:
            along = px_s = 0.0
        elif state is not FeedState.UNKNOWN and self._speeds:
            _, x, y, along = (median(values) for values in zip(*self._speeds, strict=True))
            px_s = float(np.hypot(x, y)) / self._roi.scale
        load = median(self._loads)
        self.status = replace(
            self.status,
            since_s=self._since_s,
            speed_px_s=px_s,
            speed_mm_s=along if self._calibrated else None,
            load=load if self._shows or load >= self._config.empty_below else None,
        )
