"""A Bernoulli filter of point detections beside Stone Soup's: `python -m tests.reproduction points`.

The filter of paper 1 asks a likelihood for the log ratio of a state. With a scan of positions in place of a picture
that ratio is log(1 - p_D + p_D sum of g(z | x) / (lambda c(z))), and the filter is the Bernoulli particle filter of
Ristic, Vo, Vo, Farina 2013, which Stone Soup has as well. Both get the same scans, numbers of particles, probabilities,
motion and law of births.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models import Births, ConstantVelocity, ExistenceChain, FixedSwitching, JdtFilter, KernelBirths
from lumpwatch.models.state import Labels, States, X, Y
from tests.benchmarks.peers import stone_soup_version
from tests.models.helpers import births_over
from tests.models.helpers import flat_profile as profile

DOCS = Path(__file__).parents[2] / "docs"
Array = NDArray[np.float64]
SIDE, FRAMES, SHOWN, DT = 200, 80, (10, 60), 1.0
"""Pixels, scans, the scans with a target from first to last, seconds."""
P_D, CLUTTER, NOISE, TURNS, SPEED = 0.9, 5.0, 3.0, 0.7, 2.0
"""Detection, false alarms a scan, px, px/s gathered in one second, px/s."""
P_BIRTH = P_DEATH = 0.01
FAR = 20.0
"""Cut-off of the distance, px."""
BORN = 0.3
Estimate = Array | None


@dataclass(frozen=True)
class Scene:
    """Positions a scan, and where the target is; None where there is none."""

    scans: tuple[Array, ...]
    truth: tuple[Estimate, ...]


def make_scene(seed: int) -> Scene:
    """A target of nearly constant velocity amid uniform false alarms."""
    rng = np.random.default_rng(seed)
    place, speed = rng.uniform(60.0, 140.0, 2), SPEED * rng.standard_normal(2)
    scans, truth = [], []
    for t in range(FRAMES):
        there = SHOWN[0] <= t < SHOWN[1]
        found = [rng.uniform(0.0, SIDE, 2) for _ in range(rng.poisson(CLUTTER))]
        if there:
            speed = speed + TURNS * np.sqrt(DT) * rng.standard_normal(2)
            speed = np.where(
                (place < 20.0) & (speed < 0.0) | (place > SIDE - 20.0) & (speed > 0.0), -speed, speed
            )
            place = place + speed * DT
            if rng.random() < P_D:
                found.append(place + NOISE * rng.standard_normal(2))
        truth.append(place if there else None)
        scans.append(rng.permutation(np.array(found).reshape(-1, 2)))
    return Scene(tuple(scans), tuple(truth))


@dataclass(frozen=True)
class Scan:
    """One scan as an observation."""

    places: Array

    def log_ratio(self, states: States) -> Array:
        """log p(scan | x) - log p(scan | no target), (n,)."""
        apart = states[:, None, [X, Y]] - self.places[None]
        near = np.exp(-0.5 * np.square(apart / NOISE).sum(axis=2)) / (2.0 * np.pi * NOISE**2)
        return np.log(1.0 - P_D + P_D * near.sum(axis=1) * SIDE**2 / CLUTTER)


@dataclass(frozen=True)
class Moved:
    """Births at the last scan's detections, moved on to this one, as Stone Soup has them."""

    births: KernelBirths
    model: ConstantVelocity

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        """`n` newborn states (n, 8) and their motion models (n,)."""
        states, labels = self.births.draw(n, rng)
        return self.model.move(states, DT, rng), labels


def ours(scene: Scene, particles: int, seed: int, at_detections: bool) -> Iterator[tuple[float, Estimate]]:
    """Existence and place; `at_detections`: newborn ones start where the last scan had something, as Stone Soup's."""
    total = -np.log(1.0 - P_BIRTH - P_DEATH) / DT
    law = profile((0.0, 0.0, 2.0, 2.0), SPEED)
    anywhere = replace(births_over(SIDE, SIDE), profile=law)
    straight = ConstantVelocity("straight", TURNS)
    jdt = JdtFilter(
        (straight,),
        FixedSwitching(np.eye(1), DT, np.zeros(1, np.bool_)),
        anywhere,
        law,
        ExistenceChain(total * P_BIRTH / (P_BIRTH + P_DEATH), total * P_DEATH / (P_BIRTH + P_DEATH)),
        particles=particles,
        born_share=BORN,
    )
    rng = np.random.default_rng(seed)
    belief, last = jdt.start(rng), np.zeros((0, 2))
    for places in scene.scans:
        births: Births = anywhere
        if at_detections and len(last):
            births = Moved(KernelBirths(last, np.full(2, NOISE), anywhere, 0.0), straight)
        step = replace(jdt, births=births).step(belief, Scan(places), DT, rng)
        belief, last = step.belief, places
        yield belief.existence, belief.states[:, [X, Y]].mean(axis=0)


class _Births:
    """Stone Soup's sampler of newborn particles, by the same law as ours."""

    def __init__(self, number: int, at_detections: bool, rng: np.random.Generator) -> None:
        self._number, self._at_detections, self._rng = number, at_detections, rng

    def sample(self, detections: Any, **_: Any) -> Any:
        """Newborn particles, given the detections of the scan before."""
        from stonesoup.types.array import StateVectors
        from stonesoup.types.state import ParticleState

        n, rng = self._number, self._rng
        places = [
            np.asarray(one.state_vector, float).ravel()
            for one in detections or ()
            if one.state_vector is not None
        ]
        if self._at_detections and places:
            at = np.array(places)[rng.integers(len(places), size=n)] + NOISE * rng.standard_normal((n, 2))
        else:
            at = rng.uniform(0.0, SIDE, (n, 2))
        speed = SPEED * rng.standard_normal((n, 2))
        states = np.stack([at[:, 0], speed[:, 0], at[:, 1], speed[:, 1]])
        return ParticleState(state_vector=StateVectors(states), weight=np.full(n, 1.0 / n))


def theirs(scene: Scene, particles: int, seed: int, at_detections: bool) -> Iterator[tuple[float, Estimate]]:
    """The same from Stone Soup's Bernoulli particle filter."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel
    from stonesoup.models.transition.linear import ConstantVelocity as Straight
    from stonesoup.predictor.particle import BernoulliParticlePredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.detection import Detection, MissedDetection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.multihypothesis import MultipleHypothesis
    from stonesoup.types.state import BernoulliParticleState
    from stonesoup.updater.particle import BernoulliParticleUpdater

    np.random.seed(seed)  # noqa: NPY002 - Stone Soup draws from the global generator
    rng, born = np.random.default_rng(seed), round(BORN * particles)
    kept = particles - born
    predictor = BernoulliParticlePredictor(
        CombinedLinearGaussianTransitionModel([Straight(TURNS**2), Straight(TURNS**2)]),
        birth_probability=P_BIRTH,
        survival_probability=1.0 - P_DEATH,
        birth_sampler=_Births(born, at_detections, rng),
    )
    seen = LinearGaussian(4, (0, 2), np.eye(2) * NOISE**2)
    updater = BernoulliParticleUpdater(
        measurement_model=None,
        resampler=SystematicResampler(),
        clutter_rate=CLUTTER,
        clutter_distribution=1.0 / SIDE**2,
        detection_probability=P_D,
        nsurv_particles=kept,
    )
    now = datetime(2025, 1, 1)
    state: Any = BernoulliParticleState(
        state_vector=_Births(kept, False, rng).sample(None).state_vector,
        weight=np.full(kept, 1.0 / kept),
        existence_probability=1e-6,  # its logarithm is taken
        timestamp=now,
    )
    for places in scene.scans:
        now += timedelta(seconds=DT)
        prediction = predictor.predict(state, timestamp=now)
        found = [Detection(place[:, None], now, measurement_model=seen) for place in places]
        scan = found or [MissedDetection(timestamp=now)]
        state = updater.update(MultipleHypothesis([SingleHypothesis(prediction, one) for one in scan]))
        state.parent = None  # the history would grow from scan to scan
        weights = np.exp(np.asarray(state.log_weight, float))
        yield float(state.existence_probability), np.asarray(state.state_vector, float)[[0, 2]] @ weights


def distance(truth: Estimate, found: Estimate) -> tuple[float, float]:
    """OSPA and GOSPA (order 2, alpha 2) of sets of one or none, px."""
    if truth is None and found is None:
        return 0.0, 0.0
    if truth is None or found is None:
        return FAR, FAR / np.sqrt(2.0)
    near = min(float(np.hypot(*(truth - found))), FAR)
    return near, near


BIRTHS = {"anywhere": False, "at the last scan's detections": True}
NUMBERS, SCENES = (1000,), 16


@dataclass(frozen=True)
class Measured:
    """Of one filter and number of particles, scene by scene (n,); and milliseconds a scan."""

    ospa: Array
    gospa: Array
    ms: float


def measure(
    filter_: Callable[..., Iterator[tuple[float, Estimate]]], particles: int, at: bool, scenes: int
) -> Measured:
    """Follow every scene."""

    def follow(seed: int) -> list[tuple[float, Estimate]]:
        return list(filter_(make_scene(seed), particles, seed, at_detections=at))

    follow(0)  # compiles
    began = process_time()
    runs = [follow(seed) for seed in range(scenes)]
    spent = process_time() - began
    errors = np.array([
        np.mean(
            [distance(t, x if e > 0.5 else None) for t, (e, x) in zip(make_scene(seed).truth, run, strict=True)],
            axis=0,
        )
        for seed, run in enumerate(runs)
    ])  # fmt: skip
    return Measured(errors[:, 0], errors[:, 1], 1e3 * spent / (scenes * FRAMES))


def main(docs: Path = DOCS, numbers: tuple[int, ...] = NUMBERS, scenes: int = SCENES) -> None:
    """Compare, and write the page below `docs`."""
    if stone_soup_version() is None:
        print("  points: skipped, because Stone Soup is not installed")
        return
    lines = []
    for births, at in BIRTHS.items():
        for number in numbers:
            mine, peer = (measure(one, number, at, scenes) for one in (ours, theirs))
            lines += [
                _line("lumpwatch", births, number, mine, peer),
                _line("Stone Soup", births, number, peer, peer),
            ]
    (docs / "results").mkdir(parents=True, exist_ok=True)
    told = (__doc__ or "").partition("\n\n")[2].strip()
    text = _PAGE.format(
        told=told, version=stone_soup_version(), scenes=scenes, frames=FRAMES, first=SHOWN[0], last=SHOWN[1] - 1,
        side=SIDE, noise=NOISE, detection=P_D, clutter=CLUTTER, far=FAR, rows="\n".join(lines),
    )  # fmt: skip
    (docs / "results" / "points.md").write_text(text, encoding="utf-8")


def _line(name: str, births: str, number: int, found: Measured, peer: Measured) -> str:
    less = found.ospa - peer.ospa
    spread = 2.0 * float(less.std(ddof=1)) / np.sqrt(len(less))
    beside = "" if found is peer else f" ({less.mean():+.2f} ± {spread:.2f})"
    times = "" if found is peer else f" ({peer.ms / found.ms:.1f} times faster)"
    means = f"{found.ospa.mean():.2f}{beside} | {found.gospa.mean():.2f}"
    return f"| {name} | {births} | {number:,} | {means} | {found.ms:.2f}{times} |"


_PAGE = """\
<!-- Written by `python -m tests.reproduction points`. -->

# A Bernoulli filter of point detections, beside Stone Soup's

{told}

Stone Soup {version}, {scenes} scenes of {frames} scans, with a target in scans {first} to {last} amid uniform false
alarms ({clutter:g} a scan) in {side} x {side} px; it is detected with probability {detection:g}, measured to
{noise:g} px, and turns round before the edges, which neither filter knows. A target counts as found from an existence
of 0.5 on. OSPA and GOSPA (order 2, alpha 2, cut off at {far:g} px) are means over scans and scenes; in brackets the
difference to Stone Soup's with the 95 % interval of the paired mean: below 0 is better. Time is that of one core, the
likelihood included. Filters with several motion models: [manoeuvres](manoeuvres.md).

| filter | births | particles | OSPA (px) | GOSPA (px) | ms a scan |
|---|---|---|---|---|---|
{rows}
"""
