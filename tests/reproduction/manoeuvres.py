"""Several motion models on point detections, beside Stone Soup's: `python -m tests.reproduction manoeuvres`.

One target moves by one of two constant velocity models, with little and with much noise, which alternate by a Markov
chain. It is measured alone: no false alarms, a detection in nine of ten scans. All filters get the same scans, first
position, motion models and number of particles; those with a transition matrix get the true one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models import ConstantVelocity, ExistenceChain, FixedSwitching, JdtFilter
from lumpwatch.models.jdt.switching import draw
from lumpwatch.models.state import SIZE, VX, VY, H, Labels, States, W, X, Y, blank
from lumpwatch.models.trackers.imm_pf import ImmFilter, ImmOptions
from lumpwatch.models.trackers.imm_pf.filter import joint_weights
from tests.benchmarks.peers import stone_soup_version
from tests.models.helpers import flat_profile

DOCS = Path(__file__).parents[2] / "docs"
Array = NDArray[np.float64]
FRAMES, DT, P_D, NOISE, SPEED = 80, 1.0, 0.9, 3.0, 2.0
"""Scans, seconds, detection, px, px/s at the start."""
TURNS = (0.1, 3.0)
"""px/s that gather in one second, of either model."""
MATRIX = np.array([[0.95, 0.05], [0.15, 0.85]])
STAYS = np.array([0.75, 0.25])
"""Its stationary law."""
FAR = 20.0
"""Cut-off of the distance, px."""
PARTICLES, SCENES = 1000, 30
_CLUTTER = 1e-8
"""Density of false alarms a px^2 that our filter of existence is given: none, so the target is sure to be there."""


@dataclass(frozen=True)
class Scene:
    """Where the target is (n, 2), and its detection in each scan (2,) or None."""

    truth: Array
    scans: tuple[Array | None, ...]


def make_scene(seed: int) -> Scene:
    """The first scan always has a detection."""
    rng = np.random.default_rng(seed)
    place, speed, model = np.zeros(2), SPEED * rng.standard_normal(2), 0
    truth, scans = [], []
    for t in range(FRAMES):
        if t:
            model = int(rng.random() < MATRIX[model, 1])
            states = blank(1)
            states[0, [X, Y]], states[0, [VX, VY]] = place, speed
            moved = ConstantVelocity("m", TURNS[model]).move(states, DT, rng)[0]
            place, speed = moved[[X, Y]], moved[[VX, VY]]
        truth.append(place)
        seen = t == 0 or rng.random() < P_D
        scans.append(place + NOISE * rng.standard_normal(2) if seen else None)
    return Scene(np.array(truth), tuple(scans))


def _log_near(states: States, place: Array) -> Array:
    apart = (states[:, [X, Y]] - place) / NOISE
    return np.asarray(-0.5 * np.square(apart).sum(axis=1) - np.log(2.0 * np.pi * NOISE**2))


@dataclass(frozen=True)
class _First:
    """Births around the first detection."""

    place: Array

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        """`n` newborn states (n, 8) and their motion models (n,)."""
        states = blank(n)
        states[:, [X, Y]] = self.place + NOISE * rng.standard_normal((n, 2))
        states[:, [VX, VY]] = SPEED * rng.standard_normal((n, 2))
        states[:, [W, H]] = 1.0
        return states, draw(np.broadcast_to(STAYS, (n, 2)), rng)


@dataclass(frozen=True)
class _Scan:
    """A detection or none, as an observation."""

    place: Array | None

    def log_ratio(self, states: States) -> Array:
        """log p(scan | x) - log p(scan | no target), (n,)."""
        if self.place is None:
            return np.full(len(states), np.log(1.0 - P_D))
        return np.log(P_D / _CLUTTER) + _log_near(states, self.place)


def _models() -> tuple[ConstantVelocity, ...]:
    return tuple(ConstantVelocity(f"v{k}", noise) for k, noise in enumerate(TURNS))


def paper1(scene: Scene, seed: int) -> Iterator[Array]:
    """The filter of paper 1 with the true matrix (Eq. 10); it also keeps the target's existence."""
    rng = np.random.default_rng(seed)
    first = scene.scans[0]
    assert first is not None
    jdt = JdtFilter(
        _models(),
        FixedSwitching(MATRIX, DT, np.zeros(2, np.bool_)),
        _First(first),
        flat_profile((0.0, 0.0, 0.0, 0.0), SPEED),
        ExistenceChain(0.1, 1e-4),
        particles=PARTICLES,
        born_share=0.02,
    )
    belief = jdt.start(rng)
    for scan in scene.scans:
        belief = jdt.step(belief, _Scan(scan), DT, rng).belief
        yield np.asarray(belief.states[:, [X, Y]].mean(axis=0))


def paper2(scene: Scene, seed: int) -> Iterator[Array]:
    """The filter of paper 2: no matrix, models exchange particles by resampling."""
    rng = np.random.default_rng(seed)
    imm = ImmFilter(_models(), ImmOptions(particles=PARTICLES, all_every=1, model_every=0))
    spread = np.zeros(SIZE)
    spread[[X, Y]], spread[[VX, VY]] = NOISE, SPEED
    mean = blank(1)[0]
    mean[[X, Y]] = scene.scans[0]
    belief = imm.start(mean, spread, rng)
    for t, scan in enumerate(scene.scans):
        if t:
            before, states = belief, imm.predict(belief, DT, rng)
            seen = np.zeros(PARTICLES) if scan is None else _log_near(states, scan)
            belief, _ = imm.correct(before, states, seen)
            place = joint_weights(belief) @ belief.states[:, [X, Y]]
            belief = imm.resample(belief, before, rng)
        else:
            place = joint_weights(belief) @ belief.states[:, [X, Y]]
        yield np.asarray(place)


def kalman(scene: Scene, seed: int) -> Iterator[Array]:
    """The yardstick: two Kalman filters that interact (Blom, Bar-Shalom 1988), with the true matrix."""
    del seed
    f = np.array([[1.0, DT], [0.0, 1.0]])
    noises = [q**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]]) for q in TURNS]
    mean = np.zeros((2, 2, 2))  # model, axis, (position, velocity)
    mean[:, :, 0] = scene.scans[0]
    covers = np.tile(np.diag([NOISE**2, SPEED**2]), (2, 2, 1, 1))
    shares = STAYS.copy()
    for t, scan in enumerate(scene.scans):
        if t:
            joint = MATRIX * shares[:, None]
            shares = joint.sum(axis=0)
            mix = joint / shares
            mixed = np.einsum("ij,iak->jak", mix, mean)
            apart = mean[:, None] - mixed[None]
            spread = covers[:, None] + apart[..., :, None] * apart[..., None, :]
            covers = np.einsum("ij,ijakl->jakl", mix, spread)
            for j, noise in enumerate(noises):
                mean[j] = mixed[j] @ f.T
                covers[j] = f @ covers[j] @ f.T + noise
            log = np.zeros(2)
            if scan is not None:
                gain = covers[..., 0] / (covers[..., 0, 0] + NOISE**2)[..., None]
                off = scan - mean[..., 0]
                total = covers[..., 0, 0] + NOISE**2
                log = -0.5 * (off**2 / total + np.log(total)).sum(axis=1)
                mean = mean + gain * off[..., None]
                covers = covers - gain[..., :, None] * covers[..., 0, None, :]
            shares = shares * np.exp(log - log.max())
            shares /= shares.sum()
        yield np.asarray(shares @ mean[:, :, 0])


def stone_soup(scene: Scene, seed: int) -> Iterator[Array]:
    """Stone Soup's particle filter of several models."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel
    from stonesoup.models.transition.linear import ConstantVelocity as Straight
    from stonesoup.predictor.particle import MultiModelPredictor
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import MultiModelParticleState
    from stonesoup.updater.particle import MultiModelParticleUpdater

    np.random.seed(seed)  # noqa: NPY002 - Stone Soup draws from the global generator
    rng, n, now = np.random.default_rng(seed), PARTICLES, datetime(2025, 1, 1)
    moves = [CombinedLinearGaussianTransitionModel([Straight(q**2), Straight(q**2)]) for q in TURNS]
    predictor = MultiModelPredictor(
        transition_models=moves, transition_matrix=MATRIX, model_mappings=[[0, 1, 2, 3]] * 2
    )
    seen = LinearGaussian(4, (0, 2), np.eye(2) * NOISE**2)
    updater = MultiModelParticleUpdater(
        measurement_model=seen, predictor=predictor, resampler=SystematicResampler()
    )
    born, labels = _First(np.asarray(scene.scans[0])).draw(n, rng)
    state: Any = MultiModelParticleState(
        state_vector=StateVectors(born[:, [X, VX, Y, VY]].T),
        weight=np.full(n, 1.0 / n),
        timestamp=now,
        dynamic_model=labels,
    )
    for t, scan in enumerate(scene.scans):
        if t:
            now += timedelta(seconds=DT)
            prediction = predictor.predict(state, timestamp=now)
            if scan is None:
                state = prediction
            else:
                state = updater.update(SingleHypothesis(prediction, Detection(scan[:, None], timestamp=now)))
                state.parent = None  # the history would grow from scan to scan
        weights = np.exp(np.asarray(state.log_weight, float))
        yield np.asarray(state.state_vector, float)[[0, 2]] @ weights


Filter = Callable[[Scene, int], Iterator[Array]]
FILTERS: dict[str, Filter] = {
    "lumpwatch, paper 1 (fixed matrix)": paper1,
    "lumpwatch, paper 2 (no matrix)": paper2,
    "Stone Soup, `MultiModelParticleUpdater`": stone_soup,
    "Kalman filters that interact (yardstick)": kalman,
}


def measure(one: Filter, scenes: int) -> tuple[Array, float]:
    """Mean OSPA of each scene (n,), px, and milliseconds a scan."""
    list(one(make_scene(0), 0))  # compiles
    made = [make_scene(seed) for seed in range(scenes)]
    began = process_time()
    runs = [np.array(list(one(scene, seed))) for seed, scene in enumerate(made)]
    spent = process_time() - began
    apart = [np.hypot(*(run - scene.truth).T) for run, scene in zip(runs, made, strict=True)]
    return np.array([np.minimum(one, FAR).mean() for one in apart]), 1e3 * spent / (scenes * FRAMES)


def main(docs: Path = DOCS, scenes: int = SCENES) -> None:
    """Compare, and write the page below `docs`."""
    if stone_soup_version() is None:
        print("  manoeuvres: skipped, because Stone Soup is not installed")
        return
    found = {name: measure(one, scenes) for name, one in FILTERS.items()}
    peer, peer_ms = found["Stone Soup, `MultiModelParticleUpdater`"]
    lines = []
    for name, (error, ms) in found.items():
        less = error - peer
        spread = 2.0 * float(less.std(ddof=1)) / np.sqrt(scenes)
        beside = "" if error is peer else f" ({less.mean():+.2f} ± {spread:.2f})"
        times = "" if error is peer else f" ({peer_ms / ms:.1f} times)"
        lines.append(f"| {name} | {error.mean():.2f}{beside} | {ms:.2f}{times} |")
    (docs / "results").mkdir(parents=True, exist_ok=True)
    told = (__doc__ or "").partition("\n\n")[2].strip()
    text = _PAGE.format(
        told=told, version=stone_soup_version(), scenes=scenes, frames=FRAMES, particles=PARTICLES, few=TURNS[0],
        many=TURNS[1], noise=NOISE, far=FAR, matrix=MATRIX.tolist(), rows="\n".join(lines),
    )  # fmt: skip
    (docs / "results" / "manoeuvres.md").write_text(text, encoding="utf-8")


_PAGE = """\
<!-- Written by `python -m tests.reproduction manoeuvres`. -->

# Several motion models on point detections, beside Stone Soup's

{told}

Stone Soup {version}, {scenes} scenes of {frames} scans, one a second; velocities gather {few:g} or {many:g} px/s in a
second, by the matrix {matrix}; positions are measured to {noise:g} px; {particles:,} particles. The target is always
there and one place is always told, so OSPA and GOSPA are the same: the distance, cut off at {far:g} px, mean over scans
and scenes. In brackets the difference to Stone Soup's with the 95 % interval of the paired mean (below 0 is
better), and how many times faster. Time is that of one core, the likelihood included; ours of paper 1 also keeps the
probability that the target exists.

| filter | OSPA and GOSPA (px) | ms a scan |
|---|---|---|
{rows}

Stone Soup's draws each particle's next model by the matrix and then multiplies its weight by the same entry of the
matrix, so that likely changes count twice.
"""
