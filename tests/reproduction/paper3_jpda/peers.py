"""Stone Soup's joint probabilistic data association on the same predictions and scans."""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.jpda import Association, associate
from lumpwatch.models.trackers.jpda.kalman import Gaussians, innovations, predict, update
from tests.reproduction.paper3_jpda.simulation import (
    AREA,
    GATE,
    GATE_PROBABILITY,
    MODEL,
    NOISE,
    STEPS,
    TARGETS,
    Setting,
    draw,
    jpda,
)

Array = NDArray[np.float64]
MOST_EVENTS = 20_000
"""Situations with more combinations of gated measurements are left out: Stone Soup enumerates them all."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Predicted targets and a scan."""

    states: Gaussians
    scan: Array
    detection: float
    clutter: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Stone Soup's associator beside ours, on some situations."""

    name: str
    situations: int
    difference: float
    """Largest difference of any marginal probability."""
    ratio: float
    """Median of Stone Soup's time over ours, situation by situation."""


def available() -> bool:
    """Whether Stone Soup can be imported."""
    try:
        import stonesoup  # noqa: F401
    except ImportError:
        return False
    return True


def compare(setting: Setting, count: int) -> list[Comparison]:
    """Exact marginals and belief propagation on `count` situations of a setting's runs."""
    from stonesoup.dataassociator.probability import JPDA, JPDAwithLBP

    situations = _situations(setting, count)
    rough: Callable[[Array, float, float], Association] = lambda density, detection, clutter: associate(  # noqa: E731
        density, detection, clutter, GATE_PROBABILITY, exact=0
    )
    found = []
    for name, kind, ours in (("JPDA", JPDA, jpda), ("JPDAwithLBP", JPDAwithLBP, rough)):
        differences, ratios = [], []
        for situation in situations:
            theirs, their_s = _theirs(kind, situation)
            density = _density(situation)
            ours(density, situation.detection, situation.clutter)
            repeats = 20
            start = time.perf_counter()
            for _ in range(repeats):
                mine = ours(density, situation.detection, situation.clutter).beta
            our_s = (time.perf_counter() - start) / repeats
            differences.append(float(np.abs(theirs - mine).max()))
            ratios.append(their_s / our_s)
        found.append(Comparison(name, len(situations), max(differences), float(np.median(ratios))))
    return found


def _density(situation: Situation) -> Array:
    seen = innovations(situation.states, situation.scan, np.eye(2) * NOISE**2)
    return np.where(seen.distance <= GATE**2, seen.density, 0.0)


def _situations(setting: Setting, count: int) -> list[Situation]:
    """Those with most shared measurements among every fourth step of our own runs, bounded for enumeration."""
    noise, clutter = np.eye(2) * NOISE**2, setting.clutter / AREA**2
    found: list[tuple[int, int, Situation]] = []
    for seed in range(10):
        scene = draw(setting, seed)
        mean = np.zeros((TARGETS, 6))
        mean[:, :2] = scene.truth[0]
        first = np.diag([NOISE**2, NOISE**2, 1.5**2, 1.5**2, 0.0, 0.0])
        states = Gaussians(mean, np.repeat(first[None], TARGETS, axis=0))
        for k in range(STEPS):
            states = predict(states, MODEL, 1.0)
            situation = Situation(states, scene.scans[k], setting.detection, clutter)
            density = _density(situation)
            events = int(np.prod((density > 0.0).sum(axis=1) + 1))
            if k % 4 == 0 and events <= MOST_EVENTS:
                shared = int(((density > 0.0).sum(axis=0) > 1).sum())
                found.append((-shared, len(found), situation))
            beta = jpda(density, setting.detection, clutter).beta
            states = update(states, innovations(states, scene.scans[k], noise), beta, noise)
    return [situation for *_, situation in sorted(found, key=lambda item: item[:2])[:count]]


class _Ready:
    """A hypothesiser that was asked before: only the association is timed."""

    def __init__(self, hypotheses: dict[object, object]) -> None:
        self._hypotheses = hypotheses

    def hypothesise(self, track: object, detections: object, timestamp: object, **_: object) -> object:
        return self._hypotheses[track]


def _theirs(kind: type, situation: Situation) -> tuple[Array, float]:
    """Stone Soup's marginals (n, m + 1) and the seconds of its association."""
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    now = datetime.datetime(2000, 1, 1)
    still = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.0), ConstantVelocity(0.0)])
    model = LinearGaussian(4, (0, 2), np.eye(2) * NOISE**2)
    order = [0, 2, 1, 3]  # x, vx, y, vy
    tracks = [
        Track([GaussianState(mean[order, None], covariance[np.ix_(order, order)], now)])
        for mean, covariance in zip(situation.states.mean, situation.states.covariance, strict=True)
    ]
    detections = [Detection(z[:, None], now, measurement_model=model) for z in situation.scan]
    hypothesiser = PDAHypothesiser(
        KalmanPredictor(still), KalmanUpdater(model), situation.clutter, situation.detection, GATE_PROBABILITY
    )
    ready = {track: hypothesiser.hypothesise(track, detections, now) for track in tracks}
    associator = kind(_Ready(ready))
    start = time.perf_counter()
    result = associator.associate(set(tracks), set(detections), now)
    elapsed = time.perf_counter() - start
    beta = np.zeros((len(tracks), len(detections) + 1))
    for i, track in enumerate(tracks):
        for hypothesis in result[track]:
            j = detections.index(hypothesis.measurement) + 1 if hypothesis else 0
            beta[i, j] = float(hypothesis.probability)
    return beta, elapsed
