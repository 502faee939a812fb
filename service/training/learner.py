"""Training: a video and its labels -> what a ROI's filter knows.

Reads the video once, keeps working pictures of the ROI, and learns from the labelled tracks: the
motion model of each step, P(alpha_{t-1}, alpha_t), p(x_{t-1} | alpha_t), velocity and size by row,
and the likelihood (paper 1, section 2.2.2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import groupby
from pathlib import Path

import numpy as np

from lumpwatch.models.jdt import density
from lumpwatch.models.jdt.motion_prior import CellVelocities
from lumpwatch.models.jdt.row_profile import RowProfile, learn_profile
from lumpwatch.models.learning import (
    HistogramFit,
    Learned,
    LumpFit,
    MotionFit,
    Samples,
    Track,
    TrackerFit,
    fit_motion,
    fit_noise,
    fit_size,
    samples,
)
from lumpwatch.models.learning.motion import Law, ModelSpec
from lumpwatch.models.learning.sizes import with_sizes
from lumpwatch.models.learning.transitions import fit_transitions
from lumpwatch.models.roi import Roi
from lumpwatch.service.config import JdtConfig, LumpConfig, RoiConfig
from lumpwatch.service.core import Frame
from lumpwatch.service.storage import Box, LabelError, Prior, PriorMeta, check_frames
from lumpwatch.service.training.evidence_rate import temper
from lumpwatch.service.training.fitting import fit_likelihood
from lumpwatch.service.training.footage import Footage, TrainingError, read_footage
from lumpwatch.service.training.histogram_rate import tune_histogram

SMOOTHING_S = 0.14
"""Half length of the window over which positions are smoothed, for laws without a bounce."""
LEAST_SPREAD_H_S = 0.01
"""Floor of a velocity residual over one step, ROI heights per second."""
LEAST_NOISE_H_S = 0.05
"""Floor of the learned velocity noise, ROI heights per second gathered in one second."""
BIRTH_S = 0.5
"""How long after its first label an object counts as newborn."""
LEAST_BANDWIDTH_H = 0.01
"""Floor of a kernel's bandwidth, ROI heights."""
_LEAST_BIRTH = 0.05

_LAWS: dict[str, Law] = {
    "constant_position": "still",
    "random_walk": "walk",
    "constant_velocity": "velocity",
    "constant_acceleration": "rate",
    "bounce_x": "bounce_x",
    "bounce_y": "bounce_y",
    "bounce": "bounce",
    "free_acceleration": "free",
    "motion_prior": "given",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """The result of a training, and what it was learned from, for reports and plots."""

    learned: Learned
    samples: Samples
    motion: MotionFit
    width: int
    height: int
    """Size of the pictures."""
    frames: int
    """Frames of the video."""
    warnings: tuple[str, ...]

    def as_prior(self, camera: str, roi: RoiConfig, source: str, created: datetime) -> Prior:
        """What was learned, bound to its camera and ROI; `source` names the footage without its folder."""
        meta = PriorMeta(
            camera=camera,
            roi=roi.id,
            created=created,
            polygon=roi.polygon,
            aspect=self.width / self.height,
            source=source,
            frames=self.frames,
        )
        return Prior(meta, self.learned)


def train(
    roi: RoiConfig,
    frames: Iterable[Frame],
    boxes: tuple[Box, ...],
    labels_path: Path,
    video: str,
    advance: Callable[[int], None] = lambda _: None,
) -> Trained:
    """Learn one ROI. `advance` is told the number of frames read. Raises LumpwatchError."""
    config = roi.detector.learning
    footage = read_footage(roi, frames, boxes, advance)
    check_frames(boxes, footage.count, labels_path, video)
    tracks = labelled_tracks(config, footage.roi, boxes, labels_path)
    return tempered(roi, footage, learn(roi, footage, tracks, str(labels_path)))


def learn(roi: RoiConfig, footage: Footage, tracks: list[Track], source: str) -> Trained:
    """Learn one ROI from footage and the labelled tracks in it; errors name `source`."""
    config = roi.detector.learning
    height = float(footage.roi.shape[0])
    interval = footage.interval_s
    bounces = any(model.kind.startswith("bounce") for model in config.models)
    half_window = 0 if bounces else max(1, round(SMOOTHING_S / interval))
    try:
        steps = samples(tracks, interval, half_window)
    except ValueError as error:
        raise TrainingError(f"{source}: {error} inside roi {roi.id}") from error
    motion = fit_motion(steps, _specs(config, height), LEAST_SPREAD_H_S * height)
    profile = learn_profile(steps.states, height)
    lumps = isinstance(roi.detector, JdtConfig) and isinstance(config.likelihood, LumpConfig)
    if lumps or footage.roi.limit_px is not None:
        # A few lumps show at no row how much the next ones differ: all rows together do.
        profile = with_sizes(profile, steps.states, steps.starts, height)
    fit = fit_likelihood(config, footage, profile, source)
    cells = footage.cells.scaled(1.0 / height) if footage.cells is not None else None
    learned = _learned(
        config,
        steps,
        motion=motion,
        profile=profile,
        fit=fit,
        height=height,
        tracks=len(tracks),
        cells=cells,
    )
    first = max(1, round(BIRTH_S / interval))
    places = np.concatenate([track.boxes[:first, :2] for track in tracks]) / height
    tracker = None
    if not isinstance(roi.detector, JdtConfig):
        # Positions are smoothed whatever the models: bounces are none of a tracker's.
        tracker = TrackerFit(noise=fit_noise(steps, height), size=fit_size(steps, height))
    learned = replace(learned, birth_places=places, tracker=tracker)
    return Trained(
        learned=learned,
        samples=steps,
        motion=motion,
        width=footage.width,
        height=footage.height,
        frames=footage.count,
        warnings=_warnings(config, motion, len(tracks)),
    )


def tempered(
    roi: RoiConfig, footage: Footage, trained: Trained, advance: Callable[[int], None] = lambda _: None
) -> Trained:
    """The training with its evidence tempered; `advance` is told how many candidates were judged, of `TRIALS`."""
    learned = tune_histogram(roi, footage, trained.learned, advance)
    return replace(trained, learned=temper(roi, footage, learned, advance))


def with_choices_of(trained: Trained, before: Learned | None) -> Trained:
    """The training with the background model, working size and empty scene of an earlier one that chose them."""
    fit, known = trained.learned.tracker, None if before is None else before.tracker
    if fit is None or known is None:
        return trained
    kept = replace(fit, scene=known.scene, foreground=known.foreground, working_size_px=known.working_size_px)
    return replace(trained, learned=replace(trained.learned, tracker=kept))


def labelled_tracks(config: JdtConfig, roi: Roi, boxes: Sequence[Box], path: Path) -> list[Track]:
    """The labelled objects, as far as they lie inside the region. Raises LabelError."""
    names = {model.name: m for m, model in enumerate(config.models)}
    h, w = roi.shape
    tracks = []
    for _, group in groupby(boxes, key=lambda box: box.track):
        rows = list(group)
        for box in rows:
            if box.model is not None and box.model not in names:
                raise LabelError(
                    f"{path}: frame {box.frame}, id {box.track}: motion model '{box.model}' is not one of "
                    f"the configured {', '.join(names)}"
                )
        working = roi.to_working(np.array([[b.x, b.y, b.w, b.h] for b in rows]))
        inside = (working[:, :2] >= 0).all(axis=1) & (working[:, :2] < (w, h)).all(axis=1)
        if inside.any():
            frames = np.array([b.frame for b in rows], dtype=np.intp)
            labels = np.array([names[b.model] if b.model else -1 for b in rows], dtype=np.intp)
            tracks.append(Track(frames[inside], working[inside], labels[inside]))
    return tracks


def _specs(config: JdtConfig, height: float) -> list[ModelSpec]:
    specs = []
    for model in config.models:
        rate = model.acceleration_h_s2
        scaled = None if rate is None else (rate[0] * height, rate[1] * height)
        specs.append(ModelSpec(_LAWS.get(model.kind, "given"), scaled))
    return specs


def _learned(
    config: JdtConfig,
    steps: Samples,
    *,
    motion: MotionFit,
    profile: RowProfile,
    fit: LumpFit | HistogramFit,
    height: float,
    tracks: int,
    cells: CellVelocities | None,
) -> Learned:
    models = len(config.models)
    switches = fit_transitions(
        steps,
        motion.labels,
        models,
        density.COMPONENTS[config.switch_on],
        LEAST_BANDWIDTH_H * height,
        config.bandwidth,
        state_first=config.order == "state_first",
    )
    counts = np.bincount(motion.labels, minlength=models)
    momentary = np.array([model.kind.startswith("bounce") for model in config.models])
    births = np.where(momentary & ~momentary.all(), 0.0, counts / counts.sum() + _LEAST_BIRTH)
    noise = motion.spreads / np.sqrt(steps.interval_s) / height
    return Learned(
        models=tuple(model.name for model in config.models),
        rates=motion.rates / height,
        velocity_noise=np.maximum(noise, LEAST_NOISE_H_S),
        joint=switches.joint,
        interval_s=steps.interval_s,
        density=switches.densities.scaled(1.0 / height),
        births=births / births.sum(),
        profile=profile.scaled(1.0 / height),
        likelihood=fit,
        cells=cells,
        label_counts=counts.astype(np.int64),
        tracks=tracks,
    )


def _warnings(config: JdtConfig, motion: MotionFit, tracks: int) -> tuple[str, ...]:
    warnings = []
    if tracks < 5:
        warnings.append(f"only {tracks} labelled objects: eight and more make a prior that can be trusted")
    for m, model in enumerate(config.models):
        seen = int((motion.labels == m).sum())
        if seen < 5:
            warnings.append(f"motion model {model.name} was seen in {seen} steps only")
    return tuple(warnings)
