"""What is compared: configurations of the one filter, and what they learn from the training scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt import density
from lumpwatch.models.jdt.births import polygon_births
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form, JdtFilter, Order
from lumpwatch.models.jdt.motion import (
    Bounce,
    ConstantAcceleration,
    ConstantPosition,
    ConstantVelocity,
    MotionModel,
    RandomWalk,
)
from lumpwatch.models.jdt.row_profile import RowProfile, learn_profile
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching, Switching, conditional
from lumpwatch.models.learning import (
    HistogramFit,
    LabelledView,
    LumpFit,
    Samples,
    Track,
    fit_histogram,
    fit_lump,
    fit_motion,
    samples,
)
from lumpwatch.models.learning.motion import Law, ModelSpec
from lumpwatch.models.learning.transitions import fit_transitions
from lumpwatch.models.likelihood import HistogramLikelihood, Likelihood, LumpLikelihood
from lumpwatch.models.likelihood.histogram import Channel
from lumpwatch.models.roi import Roi, make_roi
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.service.detection import make_net
from tests.reproduction.paper1.scenes import Scene

Kind = Literal[
    "constant_position",
    "random_walk",
    "constant_velocity",
    "constant_acceleration",
    "bounce_x",
    "bounce_y",
]
LAWS: dict[Kind, Law] = {
    "constant_position": "still",
    "random_walk": "walk",
    "constant_velocity": "velocity",
    "constant_acceleration": "rate",
    "bounce_x": "bounce_x",
    "bounce_y": "bounce_y",
}
BIRTH, DEATH = 0.01, 0.01
"""Probability per frame that an object appears, and that it goes."""
LEAST_PROBABILITY = 1e-6
"""What a prediction is charged for at most: a single surprise would otherwise outweigh all steps."""
LEAST_BANDWIDTH_SHARE = 0.01
"""Floor of a kernel's bandwidth in picture heights."""


@dataclass(frozen=True, slots=True)
class Method:
    """One configuration of the filter."""

    name: str
    kinds: tuple[Kind, ...]
    adaptive: bool = False
    order: Order = "model_first"
    form: Form = "marginal"

    @property
    def single(self) -> bool:
        """Whether it has one motion model only."""
        return len(self.kinds) == 1


@dataclass(frozen=True, slots=True)
class Experiment:
    """A scene, the motion models in it, and all that the methods have in common."""

    key: str
    title: str
    scene: Callable[[int], Scene]
    """Test scene of a seed."""
    kinds: tuple[Kind, ...]
    names: tuple[str, ...]
    """Short names of the motion models, for plots."""
    component: str
    """What the densities are over, a key of `lumpwatch.models.jdt.density.COMPONENTS`."""
    singles: tuple[Kind, ...]
    levels: tuple[float, ...]
    """Noise levels to choose from: px/frame that the velocity gathers in a frame, or px that the
    position gathers in a frame for a model without velocity."""
    training_scene: Callable[[int], Scene] | None = None
    """Where training footage is another; otherwise `scene`, with other seeds."""
    needs_footage: bool = False
    likelihood: Channel | Literal["lump"] = "luma"
    evidence: float = 1.0
    bound: float = 4.0
    particles: int = 2000
    smoothing: int = 0
    """Half window of `samples`, frames; 0 for bounces."""
    training_seeds: tuple[int, ...] = tuple(range(1000, 1004))
    test_seeds: tuple[int, ...] = tuple(range(100, 120))  # the scenes were designed on lower ones
    about: str = ""
    """What the scene shows, for the page."""
    remarks: str = ""
    """What the figures mean, for the page."""

    def for_training(self, seed: int) -> Scene:
        """Training scene of a seed."""
        return (self.training_scene or self.scene)(seed)

    @property
    def methods(self) -> tuple[Method, ...]:
        """The adaptive filter first, its variants, the fixed matrix, and every single model."""
        return (
            Method("adaptive", self.kinds, adaptive=True),
            Method("adaptive, state first", self.kinds, adaptive=True, order="state_first"),
            Method("adaptive, sampled", self.kinds, adaptive=True, form="sampled"),
            Method("fixed matrix", self.kinds),
            *(Method(kind.replace("_", " "), (kind,)) for kind in self.singles),
        )


@dataclass(frozen=True, slots=True)
class Knowledge:
    """What the training scenes teach to all methods alike."""

    roi: Roi
    steps: Samples
    profile: RowProfile
    appearance: HistogramFit | LumpFit


@dataclass(frozen=True, slots=True)
class Motions:
    """What the training scenes teach about the motion models of one method."""

    rates: NDArray[np.float64]
    """px/s^2 (M, 2)."""
    noises: NDArray[np.float64]
    """Spread of each model's residual in units of the smallest (M,)."""
    matrix: NDArray[np.float64]
    births: NDArray[np.float64]
    densities: density.GridDensity


def learn(experiment: Experiment, scenes: Sequence[Scene]) -> Knowledge:
    """Appearance, births and motion from scenes with known boxes."""
    height, width = scenes[0].pictures[0].shape[:2]
    roi = make_roi(scenes[0].polygon, width, height, max(width, height))
    steps = samples(_tracks(scenes, roi), scenes[0].interval_s, experiment.smoothing)
    profile = learn_profile(steps.states, float(roi.shape[0]))
    births = polygon_births(roi.mask, profile, np.ones(1))
    views = [item for scene in scenes for item in labelled_views(scene, roi)]
    rng = np.random.default_rng(1)
    if experiment.likelihood == "lump":
        return Knowledge(roi, steps, profile, fit_lump([(views, births)], rng, make_net()))
    return Knowledge(roi, steps, profile, fit_histogram(views, births, experiment.likelihood, rng))


def working_boxes(scene: Scene, roi: Roi) -> NDArray[np.float64]:
    """The scene's boxes in working pixels of the region (n, 4)."""
    corners = scene.boxes.copy()
    corners[:, :2] -= corners[:, 2:] / 2
    return roi.to_working(corners)


def track(scene: Scene, roi: Roi) -> Track:
    """The object's track in working pixels."""
    frames = np.flatnonzero(scene.present)
    return Track(frames, working_boxes(scene, roi)[frames], scene.labels[frames])


def _tracks(scenes: Sequence[Scene], roi: Roi) -> list[Track]:
    """The tracks of the scenes, once where scenes differ in their noise only: copies would pass for
    evidence, and leave-one-out would find each sample in the others."""
    found: list[Track] = []
    for scene in scenes:
        one = track(scene, roi)
        if not any(np.array_equal(one.boxes, other.boxes) for other in found):
            found.append(one)
    return found


def labelled_views(scene: Scene, roi: Roi, most: int = 100) -> list[LabelledView]:
    """At most `most` frames of the scene, evenly spaced, for fitting the appearance."""
    boxes, views = working_boxes(scene, roi), []
    for i in np.unique(np.linspace(0, len(boxes) - 1, min(most, len(boxes))).astype(int)):
        picture = scene.pictures[i]
        gray, colour = (
            (picture, None) if picture.ndim == 2 else (cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), picture)
        )
        objects = blank(0 if np.isnan(boxes[i, 0]) else 1)
        if len(objects):
            objects[0, [X, Y, W, H]] = boxes[i]
        cut = None if colour is None else roi.cut(colour)
        views.append(LabelledView(roi.view(roi.cut(gray), cut), objects))
    return views


def learn_all_motions(experiment: Experiment, knowledge: Knowledge) -> tuple[Motions, ...]:
    """The motions of each method; methods with the same models and order share them."""
    known: dict[tuple[tuple[Kind, ...], Order], Motions] = {}
    for method in experiment.methods:
        if (key := (method.kinds, method.order)) not in known:
            known[key] = learn_motions(experiment, method, knowledge)
    return tuple(known[method.kinds, method.order] for method in experiment.methods)


def learn_motions(experiment: Experiment, method: Method, knowledge: Knowledge) -> Motions:
    """Rates, Eq. 13 and Eq. 14 for the method's models."""
    steps = knowledge.steps
    if method.kinds != experiment.kinds:  # labels name the experiment's models
        steps = replace(steps, given=np.full(len(steps.given), -1))
    height = float(knowledge.roi.shape[0])
    specs = [ModelSpec(LAWS[kind]) for kind in method.kinds]
    motion = fit_motion(steps, specs, 0.01 * height)
    count = len(specs)
    switches = fit_transitions(
        steps,
        motion.labels,
        count,
        density.COMPONENTS[experiment.component],
        LEAST_BANDWIDTH_SHARE * height,
        "likelihood",
        state_first=method.order == "state_first",
    )
    momentary = np.array([kind.startswith("bounce") for kind in method.kinds])
    shares = np.bincount(motion.labels, minlength=count) / len(motion.labels)
    births = np.where(momentary, 0.0, shares + 0.05)
    noises = motion.spreads / motion.spreads.min()
    return Motions(
        motion.rates, noises, conditional(switches.joint), births / births.sum(), switches.densities
    )


def label_prediction(
    experiment: Experiment, knowledge: Knowledge, motions: Motions, scenes: Sequence[Scene]
) -> tuple[float, float]:
    """Mean log probability that Eq. 12 and Eq. 10 give to the true next model of the scenes' steps.

    Without the filter and its picture: the true states are given, and labels where the scenes have none
    are inferred from their boxes.
    """
    steps = samples(_tracks(scenes, knowledge.roi), knowledge.steps.interval_s, experiment.smoothing)
    specs = [ModelSpec(LAWS[kind]) for kind in experiment.kinds]
    labels = fit_motion(steps, specs, 0.01 * float(knowledge.roi.shape[0])).labels
    now = np.flatnonzero(~steps.starts)
    momentary = np.array([kind.startswith("bounce") for kind in experiment.kinds])
    interval = steps.interval_s
    switchings: tuple[Switching, ...] = (
        AdaptiveSwitching(motions.matrix, interval, momentary, motions.densities),
        FixedSwitching(motions.matrix, interval, momentary),
    )
    adaptive, fixed = (
        float(np.log(np.maximum(rows[np.arange(len(now)), labels[now]], LEAST_PROBABILITY)).mean())
        for rows, _ in (s.rows(steps.states[now], labels[now - 1], interval) for s in switchings)
    )
    return adaptive, fixed


def make_filter(
    experiment: Experiment, method: Method, knowledge: Knowledge, motions: Motions, level: float
) -> JdtFilter:
    """The filter of a method at a noise level (px a frame)."""
    interval = knowledge.steps.interval_s
    models = tuple(
        _model(kind, level * float(noise), interval, (float(rate[0]), float(rate[1])))
        for kind, noise, rate in zip(method.kinds, motions.noises, motions.rates, strict=True)
    )
    momentary = np.array([model.momentary for model in models])
    switching: Switching = (
        AdaptiveSwitching(motions.matrix, interval, momentary, motions.densities)
        if method.adaptive
        else FixedSwitching(motions.matrix, interval, momentary)
    )
    return JdtFilter(
        models=models,
        switching=switching,
        births=polygon_births(knowledge.roi.mask, knowledge.profile, motions.births),
        profile=knowledge.profile,
        chain=ExistenceChain(BIRTH / interval, DEATH / interval),
        particles=experiment.particles,
        form=method.form,
        order=method.order,
    )


def _model(kind: Kind, level: float, interval: float, rate: tuple[float, float]) -> MotionModel:
    position_noise = level / interval**0.5
    velocity_noise = level / interval**1.5
    match kind:
        case "constant_position":
            return ConstantPosition(kind, position_noise)
        case "random_walk":
            return RandomWalk(kind, position_noise)
        case "constant_velocity":
            return ConstantVelocity(kind, velocity_noise)
        case "constant_acceleration":
            return ConstantAcceleration(kind, rate, velocity_noise)
        case "bounce_x" | "bounce_y":
            return Bounce(kind, velocity_noise, kind == "bounce_x", kind == "bounce_y")


def make_likelihood(experiment: Experiment, fit: HistogramFit | LumpFit) -> Likelihood:
    """The appearance model, the same for all methods."""
    if isinstance(fit, LumpFit):
        return LumpLikelihood(
            make_net(),
            fit.mean,
            fit.scale,
            fit.weights,
            fit.offset,
            experiment.evidence,
            experiment.bound,
            patterns=fit.patterns,
        )
    return HistogramLikelihood(
        fit.reference, fit.offset, fit.slope, experiment.evidence, experiment.bound, fit.channel
    )
