"""From configuration and prior to the parts of a tracker, in working pixels of a ROI."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lumpwatch.models.jdt.motion import AffineModel, MotionModel
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground
from lumpwatch.models.trackers.foreground import Foreground, MixtureForeground, MixtureOptions, blobs
from lumpwatch.models.trackers.imm_pf import BoxSize, ImmOptions, ImmPfTracker, TrackerOptions
from lumpwatch.models.trackers.jpda import ColourOptions, JpdaOptions, JpdaTracker, OneWay
from lumpwatch.models.trackers.scene import EmptyScene, show
from lumpwatch.models.trackers.tracked import TrackedObject
from lumpwatch.service.config import ImmPfConfig, JpdaConfig, MixtureConfig, Zone
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S, DEFAULT_SPEED_H_S
from lumpwatch.service.errors import ConfigError


class Tracker(Protocol):
    """Pictures in, objects out."""

    def step(self, picture: Image, dt: float) -> tuple[TrackedObject, ...]:
        """All objects after a BGR picture (h, w, 3), `dt` seconds after the last."""


class GatedForeground:
    """A background model that learns only while it may, and is shown the empty scene first where that is known."""

    def __init__(self, model: Foreground, scene: EmptyScene | None = None, seed: int = 0) -> None:
        """A scene that the first picture does not show, or in another light, is not used."""
        self._model = model
        self._scene, self._seed = scene, seed
        self.learns = True
        """Whether the next pictures teach it anything."""

    def apply(self, picture: Image, learn: bool = True) -> Image:
        """The mask of a picture."""
        if self._scene is not None:
            scene, self._scene = self._scene.sized(picture.shape[:2]), None
            if scene.is_of(picture):
                show(scene, self._model, np.random.default_rng(self._seed))
        return self._model.apply(picture, learn=learn and self.learns)


def make_foreground(config: ImmPfConfig | JpdaConfig, interval_s: float = DEFAULT_INTERVAL_S) -> Foreground:
    """The background model that the configuration asks for, at that distance of pictures."""
    wanted = config.background
    if isinstance(wanted, MixtureConfig):
        memory = max(1, round(wanted.memory_s / interval_s))
        return MixtureForeground(MixtureOptions(memory, wanted.threshold))
    return StatisticalBackground(
        BackgroundOptions(
            learning_rate=wanted.learning_rate,
            initial_frames=wanted.initial_frames,
            once_off_share=wanted.once_off_share,
            darkest_shadow=wanted.darkest_shadow,
        )
    )


def make_imm_pf(
    config: ImmPfConfig,
    models: tuple[MotionModel, ...],
    size: BoxSize,
    foreground: Foreground,
    rng: np.random.Generator,
    cover: Image | None = None,
) -> Tracker:
    """The tracker of paper 2; `cover` is scenery before the targets."""
    numbers = ImmOptions(config.particles, config.all_every, config.model_every, config.least_model_share)
    options = TrackerOptions(filter=numbers, hidden_s=config.hidden_s)
    return ImmPfTracker(options, models, size, foreground, rng, cover)


def make_jpda(
    config: JpdaConfig, models: tuple[MotionModel, ...], roi: Roi, foreground: Foreground
) -> Tracker:
    """The tracker of paper 3 on the regions of a foreground mask. Raises ConfigError for a model that is not affine."""
    model = models[0]
    if not isinstance(model, AffineModel):
        raise ConfigError(f"motion model {model.name}: a Kalman filter needs a model that states its law")
    height, width = roi.shape
    one_way = None
    if config.one_way is not None:
        rule = config.one_way
        one_way = OneWay(rule.direction, rule.distance_h * height, rule.for_s)
    options = JpdaOptions(
        model=model,
        noise_px=config.measurement_noise_h * height,
        detection=config.detection,
        clutter=config.clutter,
        association=config.association,
        gate_sigma=config.gate_sigma,
        space_weight=1.0 - config.colour_weight,
        colour=ColourOptions(weight=config.colour_weight),
        birth_speed=DEFAULT_SPEED_H_S * height,
        entries=_zones(config.entries, width, height),
        confirm_s=config.confirm_s,
        missed_s=config.missed_s,
        exits=_zones(config.exits, width, height),
        one_way=one_way,
    )
    least_area = max(1, round(config.least_area_share * width * height))
    return _RegionTracker(JpdaTracker(options, roi.shape), foreground, least_area)


def _zones(zones: tuple[Zone, ...], width: int, height: int) -> list[list[tuple[float, float]]]:
    return [[(x * width, y * height) for x, y in zone] for zone in zones]


class _RegionTracker:
    """JPDA on the regions of a foreground mask."""

    def __init__(self, tracker: JpdaTracker, foreground: Foreground, least_area: int) -> None:
        self._tracker, self._foreground, self._least_area = tracker, foreground, least_area

    def step(self, picture: Image, dt: float) -> tuple[TrackedObject, ...]:
        found = blobs(self._foreground.apply(picture), self._least_area)
        return self._tracker.step(found, dt, picture)
