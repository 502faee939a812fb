"""Training: a video and its labels -> what a ROI's filter knows.

Reads the video once, keeps working pictures of the ROI, and learns from the labelled tracks: the
motion model of each step, P(alpha_{t-1}, alpha_t), p(x_{t-1} | alpha_t), velocity and size by row,
and the likelihood (paper 1, section 2.2.2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models import density
from models.births import polygon_births
from models.learning import (
    HistogramFit,
    LabelledView,
    Learned,
    LumpFit,
    MotionFit,
    Samples,
    Track,
    fit_histogram,
    fit_lump,
    fit_motion,
    samples,
)
from models.learning.motion import Law, ModelSpec
from models.profile import RowProfile, learn_profile
from models.roi import Roi, make_roi
from models.state import H, W, X, Y, blank
from models.switching import joint_probabilities
from service.config.cameras import RoiConfig
from service.config.detector import HistogramConfig, JdtConfig
from service.errors import LumpwatchError
from service.frames import Frame
from service.labels import Box, LabelError, check_frames
from service.planes import working_colour, working_luma

MOST_VIEWS = 900
"""Working pictures that are kept for fitting the likelihood (a 320 x 240 one takes 75 kB)."""
SMOOTHING_S = 0.14
"""Half length of the window over which positions are smoothed, for laws without a bounce."""
LEAST_SPREAD_H_S = 0.01
"""Floor of a velocity residual over one step, ROI heights per second."""
LEAST_NOISE_H_S = 0.05
"""Floor of the learned velocity noise, ROI heights per second gathered in one second."""
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
}


class TrainingError(LumpwatchError):
    """The footage does not teach what is needed; the text says what is missing."""


@dataclass(frozen=True, slots=True)
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


def train(
    roi: RoiConfig,
    frames: Iterable[Frame],
    boxes: tuple[Box, ...],
    labels_path: Path,
    video: str,
    advance: Callable[[int], None] = lambda _: None,
) -> Trained:
    """Learn one ROI. `advance` is told the number of frames read. Raises LumpwatchError."""
    config = roi.detector
    footage = _read(roi, frames, boxes, advance)
    check_frames(boxes, footage.count, labels_path, video)
    tracks = _tracks(config, footage.roi, boxes, labels_path)
    height = float(footage.roi.shape[0])
    interval = footage.interval_s
    bounces = any(model.kind.startswith("bounce") for model in config.models)
    half_window = 0 if bounces else max(1, round(SMOOTHING_S / interval))
    try:
        steps = samples(tracks, interval, half_window)
    except ValueError as error:
        raise TrainingError(f"{labels_path}: {error} inside roi {roi.id}") from error
    motion = fit_motion(steps, _specs(config, height), LEAST_SPREAD_H_S * height)
    profile = learn_profile(steps.states, height)
    fit = _fit_likelihood(config, footage, profile, labels_path)
    learned = _learned(config, steps, motion, profile, fit, height, len(tracks))
    return Trained(
        learned,
        steps,
        motion,
        footage.width,
        footage.height,
        footage.count,
        _warnings(config, motion, len(tracks)),
    )


@dataclass(slots=True)
class _Footage:
    """What is kept of the video."""

    roi: Roi
    views: list[LabelledView]
    interval_s: float
    count: int
    width: int
    height: int


def _read(
    roi: RoiConfig, frames: Iterable[Frame], boxes: Sequence[Box], advance: Callable[[int], None]
) -> _Footage:
    """Read the video once, keeping a thinned-out set of working pictures and all capture times."""
    by_frame: dict[int, list[Box]] = {}
    for box in boxes:
        by_frame.setdefault(box.frame, []).append(box)
    geometry: Roi | None = None
    views: list[LabelledView] = []
    times: list[float] = []
    stride, size = 1, (0, 0)
    for frame in frames:
        if geometry is None:
            size = (frame.width, frame.height)
            try:
                geometry = make_roi(roi.polygon, *size, roi.detector.working_size_px)
            except ValueError as error:
                raise TrainingError(f"roi {roi.id}: {error}") from error
        if len(times) % stride == 0:
            objects = _objects(geometry, by_frame.get(len(times) + 1, ()))
            gray = working_luma(frame, geometry)
            colour = working_colour(frame, geometry) if roi.detector.needs_colour else None
            views.append(LabelledView(geometry.view(gray, colour), objects))
            if len(views) > MOST_VIEWS:
                views, stride = views[::2], stride * 2
        times.append(frame.capture_s)
        advance(len(times))
    if geometry is None or len(times) < 2:
        raise TrainingError("the video has fewer than two frames")
    interval = float(np.median(np.diff(times)))
    if not interval > 0:
        raise TrainingError("the video's frames carry no advancing time stamps")
    return _Footage(geometry, views, interval, len(times), *size)


def _objects(roi: Roi, boxes: Sequence[Box]) -> NDArray[np.float64]:
    """States of the labelled boxes whose centre lies in the region's bounding box."""
    states = blank(len(boxes))
    if boxes:
        states[:, [X, Y, W, H]] = roi.to_working(np.array([[b.x, b.y, b.w, b.h] for b in boxes]))
    h, w = roi.shape
    inside = (states[:, X] >= 0) & (states[:, X] < w) & (states[:, Y] >= 0) & (states[:, Y] < h)
    return states[inside]


def _tracks(config: JdtConfig, roi: Roi, boxes: Sequence[Box], path: Path) -> list[Track]:
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
        specs.append(ModelSpec(_LAWS[model.kind], scaled))
    return specs


def _fit_likelihood(
    config: JdtConfig, footage: _Footage, profile: RowProfile, path: Path
) -> LumpFit | HistogramFit:
    rng = np.random.default_rng(config.seed)
    births = polygon_births(footage.roi.mask, profile, np.ones(1))
    try:
        if isinstance(config.likelihood, HistogramConfig):
            return fit_histogram(footage.views, births, config.likelihood.channel, rng)
        return fit_lump(footage.views, births, rng)
    except ValueError as error:
        raise TrainingError(f"{path}: {error}") from error


def _learned(
    config: JdtConfig,
    steps: Samples,
    motion: MotionFit,
    profile: RowProfile,
    fit: LumpFit | HistogramFit,
    height: float,
    tracks: int,
) -> Learned:
    models = len(config.models)
    follows = ~steps.starts
    following = motion.labels[follows]
    previous = motion.labels[np.flatnonzero(follows) - 1]
    counts = np.bincount(motion.labels, minlength=models)
    momentary = np.array([model.kind.startswith("bounce") for model in config.models])
    births = np.where(momentary & ~momentary.all(), 0.0, counts / counts.sum() + _LEAST_BIRTH)
    noise = motion.spreads / np.sqrt(steps.interval_s) / height
    return Learned(
        models=tuple(model.name for model in config.models),
        rates=motion.rates / height,
        velocity_noise=np.maximum(noise, LEAST_NOISE_H_S),
        joint=joint_probabilities(previous, following, models),
        interval_s=steps.interval_s,
        density=density.learn(
            steps.states,
            motion.labels,
            models,
            density.COMPONENTS[config.switch_on],
            LEAST_BANDWIDTH_H * height,
        ).scaled(1.0 / height),
        births=births / births.sum(),
        profile=profile.scaled(1.0 / height),
        likelihood=fit,
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
