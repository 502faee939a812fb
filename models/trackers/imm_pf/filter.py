"""Interacting multiple models in a particle filter, for one target (paper 2, section 4).

A particle is a state, a weight and the label l of its motion model. The posterior (Eq. 6) is

    p(X_t | Z_1:t) = sum over m of pi_m  sum over n in psi_m of w_n delta(X_t - X_n)

with psi_m the particles of model m, sum of pi_m = 1, and sum of w_n = 1 within each model. One step:

    predict   X_n ~ N(tr_l(X_n), Sigma_l)                                          Eq. 7
    correct   w~_n = w_n p(Z | X_n);  w_n <- w~_n / (sum of w~ in its model)       Eq. 8
              W_m = sum of w~ in model m;  pi_m <- pi_m W_m / sum of pi_i W_i      Eq. 9
    resample  over all particles every `all_every` steps, within models every `model_every`

There is no transition prior: models exchange mass by resampling alone. Two things that the paper
leaves open are settled here:

* Resampling over all particles draws from pi_l w, so N_m / N becomes the share of a model; the
  weights start anew at 1 / N_m. Had pi kept its value, the mass of a model would count twice, in the
  number of its particles and in pi. So pi_m = N_m / N after it.
* A model below the least number of particles is filled up from N(mean, covariance) of all particles
  before the step, after either resampling ("each model has always a minimum"). Its pi becomes at
  least its share N_m / N: with pi near zero Eq. 9 could not bring it back within many steps. The
  mass is taken from the other models in proportion.

Likelihoods are logarithms, and each model's largest is taken out before exponentials: a target that
fits nowhere underflows to equal weights, not to 0 / 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import as_finite, check_positive, check_rng, check_shape
from lumpwatch.models.jdt.motion import MotionModel, move_by_label
from lumpwatch.models.jdt.resampling import Resampler, systematic
from lumpwatch.models.state import SIZE, Estimate, Labels, States

Array = NDArray[np.float64]
MOVING = 6
"""Position, velocity and acceleration are drawn; the size is not."""


@dataclass(frozen=True, slots=True)
class ImmBelief:
    """The particles of one target, Eq. 6."""

    states: States
    weights: Array
    """(N,), summing to 1 within each model."""
    labels: Labels
    shares: Array
    """pi (M,), summing to 1."""
    steps: int
    """Corrections so far."""


@dataclass(frozen=True, slots=True)
class ImmOptions:
    """Numbers of the filter, with the paper's values."""

    particles: int = 200
    """N."""
    all_every: int = 4
    """rho: steps between resamplings over all particles; 0 for never."""
    model_every: int = 5
    """phi: steps between resamplings within the models; 0 for never."""
    least_share: float = 0.1
    """gamma / N: the share of the particles that each model keeps."""


@dataclass(frozen=True, slots=True)
class ImmFilter:
    """The filter's fixed parts; its changing part is the `ImmBelief` that goes through it."""

    models: tuple[MotionModel, ...]
    options: ImmOptions = ImmOptions()
    resampler: Resampler = systematic
    """Which particles live on."""

    def __post_init__(self) -> None:
        """Raises ValueError where the options do not fit the number of models."""
        count, o = len(self.models), self.options
        if count == 0 or o.particles < count:
            raise ValueError(f"{o.particles} particles cannot serve {count} motion models")
        if not 0.0 <= o.least_share * count <= 1.0:
            raise ValueError(f"least_share {o.least_share:g} is too large for {count} models")
        if o.all_every < 0 or o.model_every < 0:
            raise ValueError("the steps between resamplings must not be negative")

    @property
    def least(self) -> int:
        """Particles that each model keeps."""
        return int(self.options.particles * self.options.least_share)

    def start(self, mean: Array, spread: Array, rng: np.random.Generator) -> ImmBelief:
        """A newborn target: states around `mean` (8,) with standard deviations `spread` (8,), N / M a model.

        Raises ValueError for a mean or spread of another shape or not finite, and an `rng` that is no Generator.
        """
        check_rng(rng)
        mean, spread = as_finite(mean, (SIZE,), "mean"), as_finite(spread, (SIZE,), "spread")
        n, count = self.options.particles, len(self.models)
        labels = np.sort(np.arange(n, dtype=np.intp) % count)
        states = mean + spread * rng.standard_normal((n, len(mean)))
        numbers = np.bincount(labels, minlength=count)
        return ImmBelief(states, 1.0 / numbers[labels], labels, np.full(count, 1.0 / count), 0)

    def predict(self, belief: ImmBelief, dt: float, rng: np.random.Generator) -> States:
        """Draw the states after `dt` seconds (Eq. 7). Raises ValueError for a dt that is not positive.

        Also for an `rng` that is no Generator.
        """
        check_rng(rng)
        return predict_all(self.models, belief.states, belief.labels, dt, rng)

    def correct(self, belief: ImmBelief, states: States, log_likelihood: Array) -> tuple[ImmBelief, float]:
        """Weigh moved states (N, 8) by log p(Z | X) (N,), Eq. 8 and 9; also the log evidence.

        The evidence is the mean likelihood over Eq. 6 before the correction. Its logarithm is -inf, and the
        weights stay, where no particle can be right. Raises ValueError for states or likelihoods of another number
        than the belief's, and a likelihood that is NaN.
        """
        n = len(belief.weights)
        check_shape(states, (n, SIZE), "states")
        check_shape(log_likelihood, (n,), "log_likelihood")
        weights, shares, log_evidence = _correct(belief.weights, belief.labels, belief.shares, log_likelihood)
        if not np.isfinite(log_evidence) and not np.max(log_likelihood) < np.inf:
            raise ValueError("log_likelihood is NaN or +inf; -inf is for 'cannot be'")
        return ImmBelief(states, weights, belief.labels, shares, belief.steps + 1), float(log_evidence)

    def resample(self, belief: ImmBelief, before: ImmBelief, rng: np.random.Generator) -> ImmBelief:
        """Resample as this step has it; missing particles are drawn around `before`, the belief before the step."""
        o = self.options
        if o.all_every and belief.steps % o.all_every == 0:
            belief = self._over_all(belief, before, rng)
        if o.model_every and belief.steps % o.model_every == 0:
            belief = self._within_models(belief, before, rng)
        return belief

    def _over_all(self, belief: ImmBelief, before: ImmBelief, rng: np.random.Generator) -> ImmBelief:
        kept = self.resampler(joint_weights(belief), len(belief.weights), rng)
        labels = belief.labels[kept]
        wanted = _topped_up(np.bincount(labels, minlength=len(self.models)), self.least)
        states, labels = self._filled(belief.states.take(kept, axis=0), labels, wanted, before, rng)
        return ImmBelief(states, 1.0 / wanted[labels], labels, wanted / wanted.sum(), belief.steps)

    def _within_models(self, belief: ImmBelief, before: ImmBelief, rng: np.random.Generator) -> ImmBelief:
        numbers = np.bincount(belief.labels, minlength=len(self.models))
        chosen = [
            members[self.resampler(belief.weights[members], len(members), rng)]
            for m in range(len(self.models))
            if len(members := np.flatnonzero(belief.labels == m))
        ]
        kept = np.concatenate(chosen)
        wanted = _topped_up(numbers, self.least)
        states, labels = self._filled(
            belief.states.take(kept, axis=0), belief.labels[kept], wanted, before, rng
        )
        filled = wanted > numbers
        shares = np.where(filled, np.maximum(belief.shares, wanted / wanted.sum()), belief.shares)
        others = shares[~filled].sum()
        if filled.any() and others > 0.0:
            shares[~filled] *= (1.0 - shares[filled].sum()) / others
        return ImmBelief(states, 1.0 / wanted[labels], labels, shares / shares.sum(), belief.steps)

    def _filled(
        self,
        states: States,
        labels: Labels,
        wanted: NDArray[np.intp],
        before: ImmBelief,
        rng: np.random.Generator,
    ) -> tuple[States, Labels]:
        """The particles with `wanted` (M,) of each model: some of the largest dropped, the missing ones drawn."""
        numbers = np.bincount(labels, minlength=len(wanted))
        if np.array_equal(numbers, wanted):
            return states, labels
        keep = np.ones(len(labels), dtype=np.bool_)
        for m in np.flatnonzero(numbers > wanted):
            members = np.flatnonzero(labels == m)
            keep[rng.choice(members, numbers[m] - wanted[m], replace=False)] = False
        missing = np.repeat(np.arange(len(wanted)), np.maximum(wanted - numbers, 0))
        states = np.concatenate([states[keep], _gaussian(before, len(missing), rng)])
        return states, np.concatenate([labels[keep], missing])


def predict_all(
    models: Sequence[MotionModel], states: States, labels: Labels, dt: float, rng: np.random.Generator
) -> States:
    """Draw the states (n, 8) after `dt` seconds, of one target or of many at once (Eq. 7).

    Raises ValueError for a dt that is not positive and finite.
    """
    check_positive(dt, "dt")
    return move_by_label(models, states, labels, dt, rng)


def joint_weights(belief: ImmBelief) -> Array:
    """pi_l w (N,), the weights of Eq. 6, summing to 1."""
    return belief.shares[belief.labels] * belief.weights


def estimate(belief: ImmBelief) -> Estimate:
    """Mean and spread of Eq. 6, and the model weights."""
    weights = joint_weights(belief)
    mean = weights @ belief.states
    variance = weights @ (belief.states - mean) ** 2
    return Estimate(mean, np.sqrt(variance), belief.shares)


def _gaussian(belief: ImmBelief, n: int, rng: np.random.Generator) -> States:
    """Draw `n` states from N(mean, covariance) of a belief; the size is the mean one.

    A sum of the deviations, each times the root of its weight and its own N(0, 1), has exactly that
    covariance, singular or not.
    """
    weights = joint_weights(belief)
    mean = weights @ belief.states
    deviations = np.sqrt(weights)[:, None] * (belief.states - mean)
    drawn = np.tile(mean, (n, 1))
    drawn[:, :MOVING] += rng.standard_normal((n, len(weights))) @ deviations[:, :MOVING]
    return drawn


def _topped_up(numbers: NDArray[np.intp], least: int) -> NDArray[np.intp]:
    """The numbers (M,) with none below `least`, and what that takes from the largest."""
    wanted = np.maximum(numbers, least)
    for _ in range(int(wanted.sum() - numbers.sum())):
        wanted[np.argmax(wanted)] -= 1
    return wanted


@njit(cache=True)
def _correct(weights, labels, shares, log_likelihood):  # type: ignore[no-untyped-def]
    """Eq. 8 and 9 with each model's largest term taken out; the log of the mean likelihood."""
    n, count = len(weights), len(shares)
    largest = np.full(count, -np.inf)
    terms = np.empty(n)
    for i in range(n):
        terms[i] = np.log(weights[i]) + log_likelihood[i] if weights[i] > 0.0 else -np.inf
        largest[labels[i]] = max(largest[labels[i]], terms[i])
    sums = np.zeros(count)
    new = np.empty(n)
    for i in range(n):
        m = labels[i]
        new[i] = np.exp(terms[i] - largest[m]) if largest[m] > -np.inf else weights[i]
        sums[m] += new[i]
    for i in range(n):
        new[i] /= sums[labels[i]]
    log_shares = np.full(count, -np.inf)
    for m in range(count):
        if shares[m] > 0.0 and largest[m] > -np.inf:
            log_shares[m] = np.log(shares[m]) + largest[m] + np.log(sums[m])
    top = log_shares.max()
    if top == -np.inf:
        return weights.copy(), shares.copy(), top
    after = np.exp(log_shares - top)
    total = after.sum()
    return new, after / total, top + np.log(total)
