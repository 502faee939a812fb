"""A shadow in replay: what a stored version would have decided otherwise on a recording."""

from __future__ import annotations

import json
from pathlib import Path

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame, RoiResult, utc
from lumpwatch.service.detection import CameraPipeline, Shadows
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import ShadowState
from lumpwatch.service.storage import Prior, PriorStore


class ReplayShadow:
    """A listener of a replay; filters every frame, however long that takes. Times count from 1970-01-01."""

    def __init__(self, camera: CameraConfig, store: PriorStore, version: int) -> None:
        """Of every ROI that has the version. Raises ConfigError where none does, PriorError."""
        self._time_s = 0.0
        self._start_s: float | None = None
        self._shadows = Shadows(camera, lambda: utc(self._time_s), None)
        self._rois = [roi.id for roi in camera.rois if version in store.versions(camera.id, roi.id)]
        if not self._rois:
            raise ConfigError(f"--shadow {version}: no roi of camera {camera.id} has a prior of that version")
        priors: dict[str, Prior] = {roi: store.load(camera.id, roi, version) for roi in self._rois}
        for roi, prior in priors.items():
            current = store.current(camera.id, roi).prior
            self._shadows.use(roi, prior, current.version if current else 0)

    def watch(self, frame: Frame, results: tuple[RoiResult, ...], pipeline: CameraPipeline) -> None:
        """The next frame."""
        self._start_s = frame.capture_s if self._start_s is None else self._start_s
        self._time_s = frame.capture_s - self._start_s
        self._shadows.follow(results, 0.0)

    def states(self) -> tuple[ShadowState, ...]:
        """What was counted in each ROI."""
        found = (self._shadows.state(roi) for roi in self._rois)
        return tuple(state for state in found if state is not None)

    def save(self, path: Path) -> None:
        """Write the states by ROI as JSON. Raises OSError."""
        content = {state.roi: state.model_dump(mode="json") for state in self.states()}
        path.write_text(json.dumps(content, indent=2, sort_keys=True) + "\n", encoding="utf-8")
