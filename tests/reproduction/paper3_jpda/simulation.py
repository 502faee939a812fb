"""The paper's simulation (Fig. 3): a known number of targets, measured with clutter and misses.

Eight targets start in [0..500] x [0..50] and move for 100 steps; false alarms are uniform in
[0..200] x [0..200]; P_D = 0.98. The paper does not give motion, measurement noise and clutter rate: here
velocities of -0.5 to 0.5 and 1 to 2 px a step, 2 px of noise, and the rates of the tables. Harder
scenes start all targets within the false alarms' area; *crossing* ones meet in pairs at a small angle.
The filter knows the number of targets and the first positions, as the paper's does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lumpwatch.models.jdt.motion import ConstantVelocity
from lumpwatch.models.trackers.jpda import Association, associate, associate_star
from lumpwatch.models.trackers.jpda.kalman import Gaussians, innovations, predict, update

Array = NDArray[np.float64]
TARGETS, STEPS, NOISE = 8, 100, 2.0
AREA = 200.0
GATE = 4.0
GATE_PROBABILITY = 1.0 - float(np.exp(-0.5 * GATE**2))
MODEL = ConstantVelocity("straight", 0.03)
LOST = 10.0
"""Distance from which an estimate has lost its target."""

Associate = Callable[[Array, float, float], Association]


@dataclass(frozen=True, slots=True)
class Setting:
    """One kind of scene."""

    name: str
    clutter: int
    """Mean number of false alarms a step."""
    detection: float = 0.98
    start: str = "paper"
    """paper: starts in [0..500] x [0..50]; dense: in [0..200] x [0..50]; crossing: in pairs that meet."""


@dataclass(frozen=True, slots=True)
class Scene:
    """One draw of a setting."""

    truth: Array
    """Positions (steps + 1, targets, 2); the first is where the filter starts."""
    scans: tuple[Array, ...]
    """Measurements of each step (m, 2), in random order."""


@dataclass(frozen=True, slots=True)
class Score:
    """How one method did on one scene."""

    held: float
    """Share of targets within `LOST` of their own estimate at every step."""
    error: float
    """Median distance of held targets (px)."""
    switches: float
    """Changes of the estimate that follows a target, a target."""


def draw(setting: Setting, seed: int) -> Scene:
    """A scene of the setting."""
    rng = np.random.default_rng([seed, setting.clutter, round(100 * setting.detection), len(setting.start)])
    position, velocity = _starts(setting.start, rng)
    truth = [position]
    for _ in range(STEPS):
        # White-noise acceleration, as in the filter's model.
        kick, rest = rng.normal(0.0, MODEL.velocity_noise, (2, TARGETS, 2))
        position = position + velocity + 0.5 * kick + rest / np.sqrt(12.0)
        velocity = velocity + kick
        truth.append(position)
    scans = []
    for position in truth[1:]:
        seen = position[rng.random(TARGETS) < setting.detection]
        measured = seen + rng.normal(0.0, NOISE, seen.shape)
        false = rng.uniform(0.0, AREA, (rng.poisson(setting.clutter), 2))
        scans.append(rng.permutation(np.vstack([measured, false])))
    return Scene(np.array(truth), tuple(scans))


def _starts(start: str, rng: np.random.Generator) -> tuple[Array, Array]:
    if start == "crossing":
        middle = np.column_stack(
            [np.linspace(35.0, 165.0, TARGETS // 2), rng.uniform(80.0, 120.0, TARGETS // 2)]
        )
        angle = rng.uniform(0.1, 0.35, TARGETS // 2) / 2.0
        speed = rng.uniform(1.0, 1.5, TARGETS // 2)
        ways = [
            np.column_stack([np.sin(side * angle), np.cos(angle)]) * speed[:, None] for side in (-1.0, 1.0)
        ]
        velocity = np.vstack(ways)
        return np.vstack([middle, middle]) - 0.5 * STEPS * velocity, velocity
    width = 500.0 if start == "paper" else 200.0
    position = np.column_stack([rng.uniform(0.0, width, TARGETS), rng.uniform(0.0, 50.0, TARGETS)])
    return position, np.column_stack([rng.uniform(-0.5, 0.5, TARGETS), rng.uniform(1.0, 2.0, TARGETS)])


def run(scene: Scene, setting: Setting, method: Associate) -> Array:
    """Estimated positions (steps + 1, targets, 2)."""
    noise = np.eye(2) * NOISE**2
    mean = np.zeros((TARGETS, 6))
    mean[:, :2] = scene.truth[0]
    covariance = np.diag([NOISE**2, NOISE**2, 1.5**2, 1.5**2, 0.0, 0.0])
    states = Gaussians(mean, np.repeat(covariance[None], TARGETS, axis=0))
    track = [mean[:, :2]]
    for scan in scene.scans:
        states = predict(states, MODEL, 1.0)
        seen = innovations(states, scan, noise)
        density = np.where(seen.distance <= GATE**2, seen.density, 0.0)
        beta = method(density, setting.detection, max(setting.clutter, 0.1) / AREA**2).beta
        states = update(states, seen, beta, noise)
        track.append(states.mean[:, :2])
    return np.array(track)


def score(scene: Scene, track: Array) -> Score:
    """Compare a run with the truth."""
    own = np.hypot(*np.moveaxis(track - scene.truth, -1, 0))
    held = np.all(own <= LOST, axis=0)
    follower = np.full(TARGETS, -1)
    switches = 0
    for k in range(STEPS + 1):
        apart = np.hypot(*np.moveaxis(scene.truth[k][:, None] - track[k][None], -1, 0))
        rows, columns = linear_sum_assignment(np.minimum(apart, LOST))
        for i, j in zip(rows, columns, strict=True):
            if apart[i, j] <= LOST:
                switches += follower[i] >= 0 and follower[i] != j
                follower[i] = j
    error = float(np.median(own[1:, held])) if held.any() else float("nan")
    return Score(float(held.mean()), error, switches / TARGETS)


def jpda(density: Array, detection: float, clutter: float) -> Association:
    """Exact marginals."""
    return associate(density, detection, clutter, GATE_PROBABILITY)


def jpda_star(density: Array, detection: float, clutter: float) -> Association:
    """The most probable permutation of each event alone."""
    return associate_star(density, detection, clutter, GATE_PROBABILITY)


def belief_propagation(density: Array, detection: float, clutter: float) -> Association:
    """The fallback of large clusters, everywhere."""
    return associate(density, detection, clutter, GATE_PROBABILITY, exact=0)


def global_nearest(density: Array, detection: float | Array, clutter: float) -> Association:
    """The one joint event of largest probability; `detection` is one probability or (n, 1)."""
    n, m = density.shape
    odds = detection * density / (clutter * (1.0 - detection * GATE_PROBABILITY))
    gain = np.log(np.maximum(odds, 1e-300))
    # A column of its own for each target's miss, at log odds 0.
    rows, columns = linear_sum_assignment(
        np.hstack([gain, np.where(np.eye(n) > 0, 0.0, -1e6)]), maximize=True
    )
    return _certain(n, m, {int(i): int(j) for i, j in zip(rows, columns, strict=True) if j < m})


def nearest(density: Array, detection: float, clutter: float) -> Association:
    """Each target takes the most likely measurement in its gate, whoever else does."""
    n, m = density.shape
    taken = {i: int(density[i].argmax()) for i in range(n) if m and density[i].max() > 0.0}
    return _certain(n, m, taken)


def _certain(n: int, m: int, taken: dict[int, int]) -> Association:
    beta = np.zeros((n, m + 1))
    for i in range(n):
        beta[i, taken.get(i, -1) + 1] = 1.0
    return Association(beta, np.zeros(n, np.bool_))


METHODS: dict[str, Associate] = {
    "JPDA*": jpda_star,
    "JPDA, exact": jpda,
    "JPDA, belief propagation": belief_propagation,
    "global nearest neighbour": global_nearest,
    "nearest neighbour": nearest,
}
RATES = (1, 2, 5, 10, 20, 50)
CHANCES = (0.7, 0.8, 0.9, 0.98)
PAPER = Setting("the paper's", 5)
SETTINGS = (
    PAPER,
    *(Setting(f"dense, {rate} false alarms", rate, start="dense") for rate in RATES),
    *(Setting(f"dense, P_D {chance:g}", 5, chance, "dense") for chance in CHANCES[:-1]),
    *(Setting(f"crossing, {rate} false alarms", rate, start="crossing") for rate in RATES),
    Setting("crossing, P_D 0.7", 5, 0.7, "crossing"),
)


def trial(setting: Setting, seed: int) -> dict[str, Score]:
    """All methods on one scene."""
    scene = draw(setting, seed)
    return {name: score(scene, run(scene, setting, method)) for name, method in METHODS.items()}
