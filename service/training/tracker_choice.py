"""Background model, working size and noise of a tracker, chosen by its score on the training clips.

Each candidate is run over the clips as the live region would be, and scored against the labels by the mean of SFDA
(are all boxes found, and do they fit) and ATA (are whole tracks held by one identity). One thing is chosen after
another, where it is better by `WORTH`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import Tracks, evaluate, tracks_of
from lumpwatch.models.learning import ForegroundChoice, Learned, TrackerFit
from lumpwatch.models.roi import Image
from lumpwatch.models.trackers.foreground import MixtureForeground, MixtureOptions, cleaned
from lumpwatch.models.trackers.scene import CoverCounts, EmptyScene, learn_scene, scaled_box, show
from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import CameraConfig, ImmPfConfig, JdtConfig, RoiConfig
from lumpwatch.service.core import working_colour
from lumpwatch.service.detection import RegionChannel, make_region
from lumpwatch.service.storage import Box, Prior
from lumpwatch.service.training.dataset import Clip, Material
from lumpwatch.service.training.watching import bound

SIZES = (320, 512, 768)
"""Working sizes that are tried, ascending; none larger than the region."""
FOREGROUNDS = (
    ForegroundChoice("mixture", 30.0),
    ForegroundChoice("mixture", 50.0),
    ForegroundChoice("mixture", 16.0),
    ForegroundChoice("statistical"),
)
NOISE_FACTORS = (0.6, 1.6)
"""Factors of the noise that are tried besides 1."""
WORTH = 0.01
"""What is chosen instead of what comes before must raise the score by this much: less is the luck of the draw, and a
larger picture costs time."""
MOST_FRAMES = 500
"""Frames of each clip that a candidate is run over."""
SCENE_PICTURES = 48
OCCUPIED = 1.3
"""A labelled box covers its object this many times its size: a shadow and a stride go beyond it."""
CANDIDATES = len(SIZES) + len(FOREGROUNDS) - 1 + len(NOISE_FACTORS)
"""Runs over the clips, at most."""


@dataclass(frozen=True, slots=True)
class Tried:
    """A candidate and its score."""

    text: str
    score: float
    chosen: bool = False


def choose(
    camera: CameraConfig,
    roi: RoiConfig,
    material: Material,
    learned: Learned,
    advance: Callable[[int], None] = lambda _: None,
) -> tuple[Learned, tuple[Tried, ...]]:
    """What was learned with the choices, and the candidates; as it was where the detector is no tracker.

    `advance` is told how many candidates, of `CANDIDATES`, are done. Raises LumpwatchError.
    """
    detector, fit = roi.detector, learned.tracker
    if isinstance(detector, JdtConfig) or fit is None:
        return learned, ()
    only = camera.model_copy(update={"rois": (roi,)})
    clips = [clip for clip in material.clips if clip.labels is not None]
    longest = max(material.footage.roi.width, material.footage.roi.height)
    configured = "working_size_px" in detector.model_fields_set
    sizes = [detector.working_size_px] if configured else _sizes(longest)
    shown = list(_pictures(only, roi, clips, sizes[-1], material.footage.count))
    fit = replace(fit, scene=learn_scene([one for one, _ in shown], [there for _, there in shown]))
    if isinstance(detector, ImmPfConfig):
        fit = replace(fit, scene=_with_cover(only, roi, clips, fit.scene, sizes[-1]))
    tried: list[Tried] = []

    def score(candidate: TrackerFit, text: str) -> float:
        prior = bound(roi, material.footage, replace(learned, tracker=candidate))
        reached = float(np.mean([_score(only, roi, clip, prior) for clip in clips]))
        tried.append(Tried(text, reached))
        advance(len(tried))
        return reached

    foreground = FOREGROUNDS[0] if detector.foreground is None else None
    best, best_score = fit, -np.inf
    for size in sizes:
        candidate = replace(fit, foreground=foreground, working_size_px=None if configured else size)
        reached = score(candidate, f"working size {size}, {_named(candidate)}")
        if reached > best_score + WORTH:
            best, best_score = candidate, reached
    for other in FOREGROUNDS[1:] if foreground is not None else ():
        candidate = replace(best, foreground=other)
        reached = score(candidate, f"working size {best.working_size_px}, {_named(candidate)}")
        if reached > best_score + WORTH:
            best, best_score = candidate, reached
    for factor in NOISE_FACTORS if isinstance(detector, ImmPfConfig) else ():
        candidate = replace(best, noise=fit.noise.times(factor))
        reached = score(candidate, f"{factor:g} times the noise")
        if reached > best_score + WORTH:
            best, best_score = candidate, reached
    advance(CANDIDATES)
    return replace(learned, tracker=best), tuple(
        replace(one, chosen=one.score == best_score) for one in tried
    )


def _sizes(longest: int) -> list[int]:
    """The working sizes below that of the region, and its own where it is smaller than the largest."""
    below = [size for size in SIZES if size < longest]
    return below if len(below) == len(SIZES) else [*below, longest]


def _named(fit: TrackerFit) -> str:
    if fit.foreground is None:
        return "foreground as configured"
    if fit.foreground.kind == "mixture":
        return f"mixture with threshold {fit.foreground.threshold:g}"
    return fit.foreground.kind


def _pictures(
    camera: CameraConfig, roi: RoiConfig, clips: Sequence[Clip], size: int, count: int
) -> Iterator[tuple[Image, Image]]:
    """Working pictures of that size, evenly over all clips, and where labelled objects are in them."""
    stride = max(1, count // SCENE_PICTURES)
    for clip in clips:
        for picture, boxes in _working(camera, roi, clip, size, stride):
            occupied = np.zeros(picture.shape[:2], np.uint8)
            for box in boxes:
                occupied[scaled_box(box, (OCCUPIED, OCCUPIED))] = 1
            yield picture, occupied


def _with_cover(
    camera: CameraConfig, roi: RoiConfig, clips: Sequence[Clip], scene: EmptyScene | None, size: int
) -> EmptyScene | None:
    """The scene with what stands before whoever passes."""
    if scene is None:
        return None
    counts = CoverCounts(scene.picture.shape[:2])
    model = MixtureForeground(MixtureOptions(threshold=FOREGROUNDS[0].threshold))
    show(scene, model, np.random.default_rng(roi.detector.seed))
    for clip in clips:
        for picture, boxes in islice(_working(camera, roi, clip, size, 1), MOST_FRAMES):
            if picture.shape == scene.picture.shape:
                counts.add(cleaned(model.apply(picture, learn=False)), boxes)
    return replace(scene, cover=counts.cover())


def _working(
    camera: CameraConfig, roi: RoiConfig, clip: Clip, size: int, stride: int
) -> Iterator[tuple[Image, NDArray[np.float64]]]:
    """Every `stride`-th working picture of that size with its labelled boxes (n, 4): centre, width and height."""
    sized = roi.model_copy(update={"detector": roi.detector.model_copy(update={"working_size_px": size})})
    by_frame: dict[int, list[tuple[float, float, float, float]]] = {}
    for box in clip.boxes:
        by_frame.setdefault(box.frame, []).append((box.x, box.y, box.w, box.h))
    frames, _ = read_frames(camera, clip.video)
    with closing(frames):
        for number, frame in enumerate(frames):
            if number % stride == 0:
                geometry = make_region(sized, frame.width, frame.height)
                picture = working_colour(frame, geometry)
                picture[geometry.mask == 0] = 0
                framed = np.array(by_frame.get(number + 1, []), np.float64).reshape(-1, 4)
                yield picture, geometry.to_working(framed)


def _score(camera: CameraConfig, roi: RoiConfig, clip: Clip, prior: Prior) -> float:
    found = list(_run(camera, roi, clip, prior))
    frames, ids, boxes = zip(*found, strict=True) if found else ((), (), ())
    scores = evaluate(tracks_of(frames, ids, boxes), _truth(clip.boxes), 0.5)
    return float(np.nan_to_num((scores.sfda + scores.ata) / 2.0))


def _truth(boxes: Sequence[Box]) -> Tracks:
    seen = [box for box in boxes if box.frame <= MOST_FRAMES]
    return tracks_of(
        [box.frame for box in seen],
        [box.track for box in seen],
        [(box.x, box.y, box.w, box.h) for box in seen],
    )


def _run(
    camera: CameraConfig, roi: RoiConfig, clip: Clip, prior: Prior
) -> Iterator[tuple[int, int, tuple[float, float, float, float]]]:
    """Frame, identity and box of everything that the tracker lists."""
    channel = RegionChannel(roi, prior)
    frames, _ = read_frames(camera, clip.video)
    with closing(frames):
        for frame in frames:
            if frame.seq >= MOST_FRAMES:
                return
            channel.fit(frame.width, frame.height)
            channel.step(frame)
            for one in channel.detection.objects if channel.detection is not None else ():
                yield frame.seq + 1, one.id, (one.x, one.y, one.w, one.h)
