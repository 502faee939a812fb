"""The methods that are compared: how each is set up, what its alarm judges, and its thresholds.

All watch the same frames and learn from the same labelled minute. What each needs to know of sizes by row
comes from those labels. The settings of the peers were chosen on training seeds: a moving belt is no still
background, so the trackers get the mixture model, which learns the ore as one more mode of each pixel (the
statistical one takes the whole belt for background and never finds anything).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.config import CameraConfig, parse_config
from lumpwatch.service.config.alarm import AlarmConfig
from lumpwatch.service.config.cameras import RoiConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.offline.backtest.curve import THRESHOLDS
from lumpwatch.service.offline.backtest.episodes import alarm_at
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.storage.prior_file import Prior
from tests.reproduction.difficulty.simple import BlobWatcher, MapWatcher, Said

ROI = "apron"
ALARM = AlarmConfig(raise_above=0.9, clear_below=0.5, on_delay_s=0.2, off_delay_s=1.0, latch=False)
"""Delays are the same for all; thresholds are each method's own."""
_HYSTERESIS = 0.95
"""A method without a memory of its own clears a little below where it raises."""
_NEARLY_SURE = (0.99995, 0.99999, 0.999999)
OURS = "adaptive"


class Watcher(Protocol):
    """One method on one feed."""

    def step(self, frame: Frame) -> Said:
        """What it says of the next frame."""


@dataclass(frozen=True, slots=True)
class Peer:
    """One method."""

    key: str
    title: str
    detector: dict[str, Any]
    """Configuration of the detector; for a method that is none, of that whose training it uses."""
    thresholds: tuple[float, ...]
    trained_as: str = OURS
    """Whose prior it takes: of the method with the same motion models."""
    simple: Callable[[RoiConfig, Prior], Watcher] | None = None
    """Makes the watcher of a method that is no detector of the product."""

    def alarm(self, raise_above: float) -> AlarmConfig:
        """The alarm at a threshold."""
        if self.simple is None:
            return alarm_at(ALARM, raise_above)
        return ALARM.model_copy(update={"raise_above": raise_above, "clear_below": _HYSTERESIS * raise_above})

    def camera(self, style: str) -> CameraConfig:
        """A calibrated camera over a feed of the style: all know which sizes matter."""
        roi: dict[str, Any] = {"id": ROI, "polygon": polygon(style), "detector": self.detector}
        roi["calibration"] = calibration(FeedSpec.model_validate({"style": style}))
        site = {"site": "matrix", "cameras": [{"id": "feed", "source": {"url": "sim:feed"}, "rois": [roi]}]}
        return parse_config(json.dumps(site)).cameras[0]  # JSON is YAML

    def watcher(self, style: str, prior: Prior) -> Watcher:
        """The method, trained, before its first frame."""
        camera = self.camera(style)
        if self.simple is not None:
            return self.simple(camera.rois[0], prior)
        return PipelineWatcher(camera, prior)


class PipelineWatcher:
    """A detector of the product in its pipeline."""

    def __init__(self, camera: CameraConfig, prior: Prior) -> None:
        self._pipeline = CameraPipeline(camera, {ROI: prior})

    def step(self, frame: Frame) -> Said:
        """See `Watcher`."""
        (result,) = self._pipeline.process(frame, frame.received_s)
        assert result.detection is not None, "the filter failed"
        assert result.prior, "the prior was refused"
        objects = result.detection.objects
        boxes = np.array([(one.x, one.y, one.w, one.h) for one in objects]).reshape(-1, 4)
        # Without a size an object has no interval either.
        sizes = [
            (np.nan,) * 3 if one.size is None else (one.size.longest_mm, one.size.low_mm, one.size.high_mm)
            for one in objects
        ]
        return Said(result.detection.alarming, boxes, np.array(sizes, dtype=float).reshape(-1, 3))


@cache
def polygon(style: str) -> tuple[tuple[float, float], ...]:
    """The region of a feed of the style; making a feed to ask it takes its time."""
    return FeedSimulator(FeedSpec.model_validate({"style": style})).polygon


def calibration(spec: FeedSpec) -> dict[str, Any]:
    """Four points of the belt clicked in the picture to the pixel, the lip, and the limit."""
    geometry = Geometry.of(spec)
    half, length = spec.belt_width_mm / 2, spec.belt_length_mm
    places = [(-half, 0.1 * length), (half, 0.1 * length), (half, 0.9 * length), (-half, 0.9 * length)]
    lip = [(-0.75 * half, length), (0.75 * half, length)]

    def clicked(points: list[tuple[float, float]]) -> list[list[float]]:
        pixels: NDArray[np.float64] = np.round(geometry.to_px(np.array(points)))
        return (pixels / (spec.width, spec.height)).tolist()

    return {
        "points": clicked(places),
        "points_mm": [list(place) for place in places],
        "lip": clicked(lip),
        "limit_mm": spec.limit_mm,
    }


_SURE = (*THRESHOLDS, *_NEARLY_SURE)
_TRACKER: dict[str, Any] = {"foreground": {"kind": "mixture"}}
_BELT_ONLY = [{"name": "belt", "kind": "constant_acceleration"}]

PEERS: dict[str, Peer] = {
    peer.key: peer
    for peer in (
        Peer(OURS, "JDT, adaptive (ours)", {"kind": "jdt"}, _SURE),
        Peer("fixed", "JDT, fixed matrix", {"kind": "jdt", "switching": "fixed"}, _SURE),
        Peer("single", "JDT, one model", {"kind": "jdt", "models": _BELT_ONLY}, _SURE, trained_as="single"),
        Peer(
            "map",
            "likelihood map, no tracking",
            {"kind": "jdt"},
            tuple(MapWatcher.level(score) for score in np.arange(-6.0, 18.5, 0.5)),
            simple=MapWatcher,
        ),
        Peer(
            "mog2",
            "MOG2 and blob size",
            {"kind": "jdt"},
            tuple(BlobWatcher.level(size) for size in np.arange(0.3, 1.96, 0.05)),
            simple=BlobWatcher,
        ),
        Peer("jpda", "JPDA", {"kind": "jpda", **_TRACKER}, _SURE, trained_as="jpda"),
        Peer("imm_pf", "IMM particle filter", {"kind": "imm_pf", **_TRACKER}, _SURE, trained_as="imm_pf"),
    )
}
