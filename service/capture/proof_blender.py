"""The camera process's part of a proof test: copies of the decoded frames with a synthetic lump."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame, tone_of
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import BlendPlan, BlendReply, place_at

log = logging.getLogger(__name__)


class BlendRequestError(LumpwatchError):
    """A plan that cannot be followed."""


class _Run:
    """One plan being followed."""

    def __init__(self, plan: BlendPlan, polygon: Sequence[tuple[float, float]]) -> None:
        # A camera process that never sees a test has no use for what draws the lump.
        from lumpwatch.service.capture import proof_render

        self.plan = plan
        self._render = proof_render
        self._polygon = np.array(polygon)
        self._rng = np.random.default_rng(plan.seed)
        if plan.lump is None:
            self._sprite = proof_render.drawn_lump(self._rng, plan.greys)
        else:
            self._sprite = proof_render.labelled_lump(plan.lump)
        self._began_s: float | None = None
        self._around: tuple[float, float] = (0.0, 0.0)
        self._noise = 0.0

    def frame(self, frame: Frame) -> Frame | None:
        """The frame with the lump; None when the test is over."""
        if self._began_s is None:
            self._began_s = frame.capture_s
            self._learn_background(frame)
        t_s = frame.capture_s - self._began_s
        if t_s > self.plan.lasts_s:
            return None
        place = place_at(self.plan.path, t_s)
        if place is None:
            return frame
        data = frame.data.copy()
        box = (
            place.x * frame.width,
            place.y * frame.height,
            place.w * frame.width,
            place.h * frame.height,
        )
        luma = data[: frame.height] if frame.encoding == "i420" else data
        self._render.blend(luma, self._sprite, box, self._around, self._noise, self._rng)
        return replace(frame, data=data)

    def _learn_background(self, frame: Frame) -> None:
        size = np.array([frame.width, frame.height])
        low, high = (
            (self._polygon.min(0) * size).astype(int),
            np.ceil(self._polygon.max(0) * size).astype(int),
        )
        luma = frame.data[: frame.height] if frame.encoding == "i420" else frame.data
        part = luma[low[1] : high[1], low[0] : high[0]]
        if part.ndim == 3:
            part = part[..., 1]  # green is most of luma
        self._around, self._noise = tone_of(part), self._render.grain(part)


class Blender:
    """Follows the newest plan; requests come in a thread of the bus, frames in the main loop."""

    def __init__(self, camera: CameraConfig) -> None:
        self._camera = camera
        self._run: _Run | None = None
        self._lock = threading.Lock()

    def request(self, parameters: dict[str, str], payload: bytes | None) -> bytes:
        """Answer a query on the blend key. Raises BlendRequestError."""
        try:
            plan = BlendPlan.model_validate_json(payload or b"")
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "payload"
            raise BlendRequestError(f"{where}: {first['msg']}") from error
        try:
            polygon = self._camera.roi(plan.roi).polygon
        except KeyError:
            raise BlendRequestError(f"roi: camera {self._camera.id} has no '{plan.roi}'") from None
        run = _Run(plan, polygon)
        with self._lock:
            self._run = run
        return BlendReply(accepted=True).line()

    def frame(self, frame: Frame) -> Frame | None:
        """The frame with the lump; None while no test runs. Never raises: the other frames matter more."""
        with self._lock:
            run = self._run
        if run is None:
            return None
        try:
            made = run.frame(frame)
        except Exception:
            log.exception("camera %s: the proof test's lump could not be drawn", self._camera.id)
            made = None
        if made is None:
            with self._lock:
                self._run = None if self._run is run else self._run
        return made
