"""Joint detection and tracking with adaptive multiple motion models (paper 1, Fig. 6).

The hybrid state is X_t = [x_t, alpha_t, E_t] (Eq. 8). One step predicts existence by its Markov chain
(Eq. 5), motion model and state (Eq. 9 to 14), weighs by the likelihood ratio (Eq. 15) and resamples.
Two forms of existence:

`sampled`   E is a component of each particle; P(E = 1) is the share of particles with E = 1 (Eq. 16).
`marginal`  All particles are alive; existence is computed from the weights (Rutten, Gordon, Maskell
            2005). With p = P(E_{t-1} = 1), survivors carry the mass (1 - P_d) p, newborn ones
            P_b (1 - p), and the rest q stays empty; then P(E_t = 1) = S / (S + q) with S the sum of
            all masses times likelihood ratios. No particle is spent on absence.

Two orders of drawing: `state_first` moves x by alpha_{t-1} and then draws alpha_t, as Eq. 9 has it
literally; `model_first` draws alpha_t and moves by it.

What the step normalises by is the evidence of the picture, p(Z_t | Z_1:t-1) over that of a picture without
an object. It costs one logarithm; its sum over a clip compares motion models and noise (Doucet, Johansen 2009,
section 3.5: the estimate of the product is unbiased).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf, isfinite, log
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import check_known, check_positive, check_rng, check_shape
from lumpwatch.models.jdt.births import Births
from lumpwatch.models.jdt.doors import check_belief, check_cause, check_parts, log_ratio_of
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.motion import MotionModel, move_by_label
from lumpwatch.models.jdt.resampling import Resampler, effective_size, systematic
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.jdt.switching import Switching, draw
from lumpwatch.models.likelihood.base import Likelihood, Observation, look
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief, Estimate, H, Labels, States, W, X, Y

Form = Literal["marginal", "sampled"]
Order = Literal["model_first", "state_first"]


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """What a step says about itself."""

    effective_particles: float
    """Effective number of the particles with E = 1."""
    fell_back_share: float
    """Share of survivors for which Eq. 12 fell back on Eq. 10."""


@dataclass(frozen=True, slots=True)
class Step:
    """Result of one step."""

    belief: Belief
    estimate: Estimate | None
    """None where no particle exists."""
    diagnostics: Diagnostics
    log_evidence: float
    """log of p(Z_t | Z_1:t-1) over the same without an object; -inf where no particle can be right."""


@dataclass(frozen=True, slots=True)
class JdtFilter:
    """The filter's fixed parts; its changing part is the `Belief` that goes through `step`."""

    models: tuple[MotionModel, ...]
    switching: Switching
    births: Births
    profile: RowProfile
    chain: ExistenceChain
    particles: int = 2000
    born_share: float = 0.3
    """Share of the particles spent on newborn states at each step (marginal form)."""
    form: Form = "marginal"
    order: Order = "model_first"
    least_share: float = 0.0
    """Share of the survivors that each motion model gets at least, however improbable it is (see `_propagate`)."""
    resampler: Resampler = systematic
    """Which particles live on."""

    def __post_init__(self) -> None:
        """Raises ValueError where the parts do not fit the number of models, or a number is out of its range."""
        check_parts(len(self.models), self.switching, self.births)
        check_known(self.form, ("marginal", "sampled"), "form")
        check_known(self.order, ("model_first", "state_first"), "order")
        if self.particles < 2 or not 0.0 <= self.born_share < 1.0:
            raise ValueError(
                "particles must be 2 or more and born_share from 0 to below 1, "
                f"not {self.particles} and {self.born_share}"
            )
        if not 0.0 <= self.least_share * len(self.models) <= 1.0:
            raise ValueError(f"least_share {self.least_share:g} is too large for {len(self.models)} models")

    def start(self, rng: np.random.Generator) -> Belief:
        """No object yet: newborn states, existence 0. Raises ValueError for an `rng` that is no Generator."""
        check_rng(rng)
        states, labels = self.births.draw(self._survivors, rng)
        return Belief(states, labels, np.full(len(states), self.form == "marginal"), 0.0)

    @property
    def _survivors(self) -> int:
        born = round(self.particles * self.born_share) if self.form == "marginal" else 0
        return self.particles - max(born, 1 if self.form == "marginal" else 0)

    def step(self, belief: Belief, observation: Observation, dt: float, rng: np.random.Generator) -> Step:
        """One frame, `dt` seconds after the last.

        Raises ValueError for a dt that is not positive, for a belief that leaves no particle to search with or
        is not one of this filter's, for states or log ratios that are not a number, and an `rng` that is no Generator.
        """
        check_positive(dt, "dt")
        check_rng(rng)
        if self.form == "marginal" and not 0 < len(belief.states) < self.particles:
            raise ValueError(
                f"the belief has {len(belief.states)} particles; of {self.particles} one must be left for newborn ones"
            )
        check_belief(belief, len(self.models))
        advance = self._step_marginal if self.form == "marginal" else self._step_sampled
        step = advance(belief, observation, dt, rng)
        if step.estimate is None or not isfinite(step.estimate.mean.sum()):
            check_cause(belief, step.estimate)
        return step

    def run(
        self,
        pictures: Iterable[Image],
        roi: Roi,
        likelihood: Likelihood,
        dt: float,
        rng: np.random.Generator,
        belief: Belief | None = None,
    ) -> Iterator[Step]:
        """A step for each working picture of a region, `dt` seconds apart: grey (h, w) or BGR (h, w, 3), uint8.

        Goes on from `belief`, or from `start`. Raises ValueError as `step` does, and for a picture of another
        size than the region's.
        """
        belief = self.start(rng) if belief is None else belief
        for _, observation in look(pictures, roi, likelihood, dt):
            step = self.step(belief, observation, dt, rng)
            belief = step.belief
            yield step

    def _step_marginal(
        self, belief: Belief, observation: Observation, dt: float, rng: np.random.Generator
    ) -> Step:
        p_birth, p_death = self.chain.probabilities(dt)
        old_states, old_labels, correction, fell_back = self._propagate(belief.states, belief.labels, dt, rng)
        new_states, new_labels = self.births.draw(self.particles - len(old_states), rng)
        states = np.concatenate([old_states, new_states])
        labels = np.concatenate([old_labels, new_labels])

        alive = (1.0 - p_death) * belief.existence
        born = p_birth * (1.0 - belief.existence)
        mass = np.empty(len(states))
        mass[: len(old_states)] = alive / len(old_states) * correction
        mass[len(old_states) :] = born / len(new_states)
        ratio, absent_ratio, log_scale = _ratios(log_ratio_of(observation, states))
        weights = mass * ratio
        total = float(weights.sum())
        evidence = total + (1.0 - alive - born) * absent_ratio
        log_evidence = _log(evidence) + log_scale
        if total <= 0.0:  # no particle is where an object could be: search anew
            return Step(self.start(rng), None, Diagnostics(0.0, fell_back), log_evidence)
        existence = total / evidence

        estimate = _estimate(states, labels, weights, len(self.models))
        kept = self.resampler(weights, len(old_states), rng)
        after = Belief(states.take(kept, axis=0), labels[kept], np.ones(len(kept), dtype=np.bool_), existence)
        return Step(after, estimate, Diagnostics(effective_size(weights), fell_back), log_evidence)

    def _step_sampled(
        self, belief: Belief, observation: Observation, dt: float, rng: np.random.Generator
    ) -> Step:
        p_birth, p_death = self.chain.probabilities(dt)
        u = rng.random(len(belief.exists))
        exists = np.where(belief.exists, u >= p_death, u < p_birth)
        survives, newborn = exists & belief.exists, exists & ~belief.exists
        states, labels = belief.states.copy(), belief.labels.copy()
        correction = np.ones(len(states))
        states[survives], labels[survives], correction[survives], fell_back = self._propagate(
            belief.states[survives], belief.labels[survives], dt, rng
        )
        states[newborn], labels[newborn] = self.births.draw(int(newborn.sum()), rng)

        ratio, absent_ratio, log_scale = _ratios(log_ratio_of(observation, states[exists]))
        weights = np.full(len(states), absent_ratio)
        weights[exists] = ratio * correction[exists]
        total = float(weights.sum())
        log_evidence = _log(total / len(weights)) + log_scale
        if total <= 0.0:  # all exist, and none where an object could be: search anew
            return Step(self.start(rng), None, Diagnostics(0.0, fell_back), log_evidence)

        alive = weights * exists
        estimate = _estimate(states, labels, alive, len(self.models)) if exists.any() else None
        kept = self.resampler(weights, len(states), rng)
        after = Belief(states.take(kept, axis=0), labels[kept], exists[kept], float(exists[kept].mean()))
        return Step(after, estimate, Diagnostics(effective_size(alive), fell_back), log_evidence)

    def _propagate(
        self, states: States, labels: Labels, dt: float, rng: np.random.Generator
    ) -> tuple[States, Labels, NDArray[np.float64], float]:
        """Draw alpha_t and x_t of the survivors (the integrand of Eq. 9), with their importance weights (n,).

        With a least share the labels are drawn from a mixture of Eq. 10 or 12 and a uniform law, and
        the weights put that right (importance sampling): a rare model keeps particles to try it.
        """
        rows, fell_back = self.switching.rows(states, labels, dt)
        check_shape(rows, (len(states), len(self.models)), "what switching.rows gives")
        following, correction = self._draw_labels(rows, rng)
        moving = following if self.order == "model_first" else labels
        moved = move_by_label(self.models, states, moving, dt, rng)
        self.profile.follow(states, moved, dt, rng)
        return moved, following, correction, float(fell_back.mean()) if len(fell_back) else 0.0

    def _draw_labels(
        self, rows: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[Labels, NDArray[np.float64]]:
        if self.least_share == 0.0:
            return draw(rows, rng), np.ones(len(rows))
        proposal = (1.0 - self.least_share * len(self.models)) * rows + self.least_share
        following = draw(proposal, rng)
        each = np.arange(len(rows))
        return following, rows[each, following] / proposal[each, following]


def _ratios(log_ratio: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Likelihood ratios with E = 1 and with E = 0 (Eq. 15), divided by the largest so that none overflows.

    Third the logarithm of what they were divided by.
    """
    largest = float(log_ratio.max(initial=0.0))  # NaN where any of them is
    if not largest < inf:
        raise ValueError("observation.log_ratio gives NaN or +inf; -inf is for a state that cannot be")
    return np.exp(log_ratio - largest), float(np.exp(-largest)), largest


def _log(value: float) -> float:
    return log(value) if value > 0.0 else -inf


def _estimate(states: States, labels: Labels, weights: NDArray[np.float64], models: int) -> Estimate | None:
    """Mean and spread around the strongest mode, and the share of each model there.

    A plain mean over particles would lie between two candidates; three steps of mean shift from the
    heaviest particle, with the box as the kernel, stay with one.
    """
    found, mean, variance, shares = _mode(states, labels, weights, models)
    return Estimate(mean, np.sqrt(variance), shares) if found else None


@njit(cache=True)
def _mode(states, labels, weights, models):  # type: ignore[no-untyped-def]
    """Mean and variance (8,) and model shares (M,) within a box around the strongest mode."""
    centre = states[np.argmax(weights)].copy()
    first, second, shares = np.zeros(8), np.zeros(8), np.zeros(models)
    for step in range(3):
        reach_x, reach_y = 0.5 * centre[W], 0.5 * centre[H]
        total = 0.0
        first[:] = 0.0
        for i in range(len(states)):
            weight = weights[i]
            if abs(states[i, X] - centre[X]) > reach_x or abs(states[i, Y] - centre[Y]) > reach_y:
                continue
            total += weight
            for k in range(8):
                # Around the last centre: no digits are lost to the distance from the origin.
                offset = states[i, k] - centre[k]
                first[k] += weight * offset
                if step == 2:
                    second[k] += weight * offset * offset
            if step == 2:
                shares[labels[i]] += weight
        if total <= 0.0:
            return False, centre, second, shares
        first /= total
        centre += first
    return True, centre, np.maximum(second / total - first * first, 0.0), shares / total
