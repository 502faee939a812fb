"""How far a camera has moved: small shifts are followed by the regions, large ones make them BLIND."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from lumpwatch.models.picture.medians import SlowMedian
from lumpwatch.models.picture.reference import moving_mask, thumbnail
from lumpwatch.models.picture.registration import Registration
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import QualityConfig
from lumpwatch.service.core import Frame, luma_of
from lumpwatch.service.storage import Reference

log = logging.getLogger(__name__)

_LEAST = 0.004  # share of the width: smaller shifts are not worth following
_SCATTER = 0.0125  # share of the width: estimates that scatter by more have found nothing
_LEAST_ESTIMATES = 3
_UNEVEN, _GOLDEN = 0.5, 0.6180339887498949


class CameraShift:
    """Registers a camera against the stills of its reference; without one it finds no shift."""

    def __init__(self, camera: str, config: QualityConfig) -> None:
        self._camera = camera
        self._config = config.moved
        self._rate_s = config.moved.every_s
        self._enabled = config.enabled and config.moved.enabled
        self._registrations: tuple[Registration, ...] = ()
        self.shift_px: tuple[float, float] | None = None
        """The slow estimate, pixels of the whole picture; None without one."""
        self.followed_px = (0, 0)
        """How far the regions are moved along."""
        self.follows = 0
        """How often they were moved."""
        self.lost = False
        """Whether the picture is too far from where it was, or cannot be found in the still."""
        self._begin(1.0)

    def fit(self, rois: Mapping[str, Roi], width: int, height: int, reference: Reference | None) -> None:
        """Register pictures of this size from now on."""
        self._registrations = ()
        self.followed_px, self.lost, self.shift_px = (0, 0), False, None
        self._begin(width)
        if reference is None or not self._enabled or not rois:
            return
        size = np.array([width, height], dtype=float)
        corners = [roi.corners / size for roi in rois.values()]
        self._registrations = tuple(
            Registration(light.still, moving_mask(corners, light.still.shape)) for light in reference.lights
        )
        self._step = max(roi.step for roi in rois.values())

    def _begin(self, width: float) -> None:
        self._width = width
        self._x, self._y = SlowMedian(self._config.window_s), SlowMedian(self._config.window_s)
        self._registered_s = float("-inf")
        self._looks = 0
        self._off_since_s: float | None = None

    def observe(self, frame: Frame, light: int) -> None:
        """Register a frame where it is time to."""
        # At even distances a camera that trembles would be caught in the same phase again and again.
        wait_s = self._rate_s * (1.0 + _UNEVEN * (self._looks * _GOLDEN % 1.0 - 0.5))
        if not self._registrations or frame.capture_s < self._registered_s + wait_s - 1e-3:
            return
        thumb = frame.thumb
        if thumb is None:
            if frame.crop is not None:
                return
            thumb = thumbnail(luma_of(frame))
        registration = self._registrations[min(light, len(self._registrations) - 1)]
        if thumb.shape != registration.shape:
            return
        self._registered_s = frame.capture_s
        self._looks += 1
        self._update(registration, thumb, frame.capture_s)

    def _update(self, registration: Registration, thumb: Image, time_s: float) -> None:
        found = registration.shift(thumb)
        scale = self._width / thumb.shape[1]
        x, y = self._x.add(time_s, found.x * scale), self._y.add(time_s, found.y * scale)
        if self._x.count < _LEAST_ESTIMATES:
            return
        self.shift_px = x, y
        scattered = max(self._x.spread, self._y.spread) > _SCATTER * self._width
        self.lost = scattered or float(np.hypot(x, y)) > self._config.follow_up_to * self._width
        self._follow(x, y, time_s)

    def _follow(self, x: float, y: float, time_s: float) -> None:
        """Move the regions along once a small shift has lasted."""
        away = max(abs(x - self.followed_px[0]), abs(y - self.followed_px[1]))
        least = max(_LEAST * self._width, 0.75 * self._step)
        # What scatters as much trembles where it is.
        if self.lost or away < least + max(self._x.range, self._y.range):
            self._off_since_s = None
            return
        self._off_since_s = time_s if self._off_since_s is None else self._off_since_s
        if time_s - self._off_since_s >= self._config.entry_s - 1e-6:
            step = self._step
            # A camera that is back is where it was: what is left is the error of the estimate.
            back = max(abs(x), abs(y)) < least
            self.followed_px = (0, 0) if back else (round(x / step) * step, round(y / step) * step)
            self.follows += 1
            self._off_since_s = None
            log.warning("camera %s: has moved by %+.1f, %+.1f px; its rois follow", self._camera, x, y)

    def placed(self, roi: Roi, width: int, height: int) -> tuple[Roi, tuple[int, int]]:
        """Where a region lies now, and by how much it was moved: not beyond the picture."""
        x = min(max(roi.x + self.followed_px[0], 0), width - roi.width)
        y = min(max(roi.y + self.followed_px[1], 0), height - roi.height)
        x, y = roi.x + (x - roi.x) // roi.step * roi.step, roi.y + (y - roi.y) // roi.step * roi.step
        return roi.at(x, y), (x - roi.x, y - roi.y)
