"""Our full step against the particle filters of Stone Soup (a benchmark-only dependency).

Both sides have the same number of particles, of which three tenths are newborn at each step, and
the same number of constant velocity models in two dimensions. The measurement is where they
differ: ours is a whole picture, from which each particle's likelihood is computed (integral images
included); theirs are positions that are handed over ready, and a Gaussian of each for each particle.
So the comparison leaves out what it would cost them to find the positions. One a frame is the least
there can be, ten stand for a detector with clutter; the multi-model filter takes one.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from typing import Any

import numpy as np

from tests.benchmarks.scene import HEIGHT, INTERVAL_S, KINDS, WIDTH, make_run
from tests.benchmarks.timing import alternate

PARTICLES = (1000, 5000)
MODELS = 3
BORN_SHARE = 0.3
NOISE_PX = 3.0
VELOCITY_NOISE = 30.0


def stone_soup_version() -> str | None:
    """The installed version; None where it cannot be imported."""
    try:
        import stonesoup  # noqa: F401

        return version("stonesoup")
    except (ImportError, PackageNotFoundError):
        return None


def _detections(positions: int) -> Callable[[datetime], list[Any]]:
    """An object that moves in a circle, measured with noise, and clutter anywhere."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.types.detection import Detection

    rng = np.random.default_rng(0)
    model = LinearGaussian(4, (0, 2), np.eye(2) * NOISE_PX**2)
    frames = count()

    def detect(at: datetime) -> list[Any]:
        angle = 0.05 * next(frames)
        places = rng.uniform((0, 0), (WIDTH, HEIGHT), (positions, 2))
        places[0] = WIDTH / 2 + 60 * np.cos(angle), HEIGHT / 2 + 60 * np.sin(angle)
        places[0] += NOISE_PX * rng.standard_normal(2)
        return [Detection(place[:, None], at, measurement_model=model) for place in places]

    return detect


def _transition(noise: float) -> Any:
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity

    return CombinedLinearGaussianTransitionModel([ConstantVelocity(noise**2), ConstantVelocity(noise**2)])


def bernoulli(particles: int, positions: int = 1) -> Callable[[], None]:
    """One predict and update of Stone Soup's Bernoulli particle filter (Ristic et al. 2013)."""
    from stonesoup.predictor.particle import BernoulliParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.sampler.detection import GaussianDetectionParticleSampler, SwitchingDetectionSampler
    from stonesoup.sampler.particle import ParticleSampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.multihypothesis import MultipleHypothesis
    from stonesoup.types.state import BernoulliParticleState
    from stonesoup.updater.particle import BernoulliParticleUpdater

    born = round(BORN_SHARE * particles)
    kept = particles - born
    rng = np.random.default_rng(1)
    low, high = np.array([0.0, -60.0, 0.0, -60.0]), np.array([WIDTH, 60.0, HEIGHT, 60.0])
    anywhere = ParticleSampler(
        distribution_func=rng.uniform, params={"low": low, "high": high, "size": (born, 4)}, ndim_state=4
    )
    at_detections = GaussianDetectionParticleSampler(nsamples=born)
    predictor = BernoulliParticlePredictor(
        _transition(VELOCITY_NOISE),
        birth_probability=0.01,
        survival_probability=0.99,
        birth_sampler=SwitchingDetectionSampler(at_detections, backup_sampler=anywhere),
    )
    updater = BernoulliParticleUpdater(
        measurement_model=None,
        resampler=SystematicResampler(),
        clutter_rate=max(positions - 1, 1),
        clutter_distribution=1 / (WIDTH * HEIGHT),
        detection_probability=0.9,
        nsurv_particles=kept,
    )
    detect, now = _detections(positions), datetime(2025, 1, 1)
    state = BernoulliParticleState(
        state_vector=StateVectors(rng.uniform(low[:, None], high[:, None], (4, kept))),
        weight=np.full(kept, 1 / kept),
        existence_probability=0.5,
        timestamp=now,
    )

    def step() -> None:
        nonlocal state, now
        now += timedelta(seconds=INTERVAL_S)
        prediction = predictor.predict(state, timestamp=now)
        hypotheses = [SingleHypothesis(prediction, detection) for detection in detect(now)]
        state = updater.update(MultipleHypothesis(hypotheses))
        state.parent = None  # the history would grow from frame to frame

    return step


def multi_model(particles: int, models: int) -> Callable[[], None]:
    """One predict and update of Stone Soup's multi-model particle filter; it knows no existence."""
    from stonesoup.predictor.particle import MultiModelPredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import MultiModelParticleState
    from stonesoup.updater.particle import MultiModelParticleUpdater

    matrix = np.full((models, models), 0.05 / max(models - 1, 1))
    np.fill_diagonal(matrix, 0.95)
    predictor = MultiModelPredictor(
        [_transition(VELOCITY_NOISE * (m + 1)) for m in range(models)], matrix, [[0, 1, 2, 3]] * models
    )
    updater = MultiModelParticleUpdater(None, predictor, resampler=SystematicResampler())
    rng = np.random.default_rng(1)
    spread = np.array([10.0, 60.0, 10.0, 60.0])[:, None]
    place = np.array([WIDTH / 2 + 60, 0.0, HEIGHT / 2, 0.0])[:, None]
    detect, now = _detections(1), datetime(2025, 1, 1)
    state = MultiModelParticleState(
        state_vector=StateVectors(place + spread * rng.standard_normal((4, particles))),
        weight=np.full(particles, 1 / particles),
        dynamic_model=rng.integers(models, size=particles),
        timestamp=now,
    )

    def step() -> None:
        nonlocal state, now
        now += timedelta(seconds=INTERVAL_S)
        prediction = predictor.predict(state, timestamp=now)
        state = updater.update(SingleHypothesis(prediction, detect(now)[0]))
        state.parent = None

    return step


def run() -> list[dict[str, object]]:
    """A row for each peer, number of particles and likelihood of ours; times in milliseconds."""
    rows: list[dict[str, object]] = []
    for particles in PARTICLES:
        for peer, models, positions, theirs in (
            ("Bernoulli", 1, 1, bernoulli(particles)),
            ("Bernoulli", 1, 10, bernoulli(particles, 10)),
            ("multi-model", MODELS, 1, multi_model(particles, MODELS)),
        ):
            runs: dict[str, Callable[[], object]] = {"theirs": theirs}
            runs |= {kind: make_run(kind, particles, models).step for kind in KINDS}
            seen = alternate(runs)
            rows += [
                {
                    "peer": peer,
                    "particles": particles,
                    "models": models,
                    "positions": positions,
                    "likelihood": kind,
                    "theirs_ms": seen.ms("theirs"),
                    "ours_ms": seen.ms(kind),
                    "ratio": seen.ratio("theirs", kind),
                }
                for kind in KINDS
            ]
    return rows
