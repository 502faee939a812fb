"""Kalman filters of several targets with a weighted update (paper 3, Eq. 25-29).

A target's state is (x, y, vx, vy, ax, ay), a measurement the centre (x, y) with white noise. Prediction
takes a motion model's own law: one step is affine, s' = F s + u + G w with independent N(0, 1) in w,
so Q = G G^T. With innovations nu_j = z_j - H s, covariance S = H P H^T + R and gain K = P H^T S^-1, the
update by association probabilities beta_j (0: missed) is the mean and covariance of the mixture:

    s <- s + K nu,   nu = sum_j beta_j nu_j
    P <- beta_0 P + (1 - beta_0) P_c + K (sum_j beta_j nu_j nu_j^T - nu nu^T) K^T,

with P_c = (I - K H) P (I - K H)^T + K R K^T. Every term is positive semidefinite.

Source: Bar-Shalom, Daum, Huang (2009), "The probabilistic data association filter".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import AffineModel

Array = NDArray[np.float64]
STATE = 6
_LIKELY = 1e-300


@dataclass(frozen=True, slots=True)
class Gaussians:
    """Independent states of n targets."""

    mean: Array
    """x, y, vx, vy, ax, ay (n, 6)."""
    covariance: Array
    """(n, 6, 6)."""


@dataclass(frozen=True, slots=True)
class Innovations:
    """How m measurements lie to n predicted targets."""

    residual: Array
    """Measurement less prediction (n, m, 2)."""
    covariance: Array
    """S (n, 2, 2)."""
    distance: Array
    """Squared Mahalanobis distance (n, m)."""

    @property
    def density(self) -> Array:
        """Gaussian density of each measurement, per px^2 (n, m)."""
        scale = 2.0 * np.pi * np.sqrt(_determinant(self.covariance))
        return np.exp(-0.5 * self.distance) / scale[:, None]


def transition(model: AffineModel, dt: float) -> tuple[Array, Array, Array]:
    """F (6, 6), u (6,) and Q (6, 6) of a model over `dt` seconds, from its law."""
    law = np.asarray(model.law(dt))  # (axis, component, coefficient)
    f, u, g = np.zeros((3, 2, 3, 2)), np.zeros((3, 2)), np.zeros((3, 2, 3, 2))
    for axis in range(2):
        f[:, axis, :, axis] = law[axis, :, :3]
        u[:, axis] = law[axis, :, 3]
        g[:, axis, :, axis] = law[axis, :, 4:]
    noise = g.reshape(STATE, STATE)
    return f.reshape(STATE, STATE), u.reshape(STATE), noise @ noise.T


def predict(states: Gaussians, model: AffineModel, dt: float) -> Gaussians:
    """The states after `dt` seconds."""
    f, u, q = transition(model, dt)
    return Gaussians(states.mean @ f.T + u, f @ states.covariance @ f.T + q)


def innovations(states: Gaussians, centres: Array, noise: Array) -> Innovations:
    """Compare measured centres, (m, 2) or as each target has them (n, m, 2), with the targets.

    `noise` (2, 2) is the covariance of a measured centre.
    """
    residual = centres - states.mean[:, None, :2]
    s = states.covariance[:, :2, :2] + noise
    x, y = residual[..., 0], residual[..., 1]
    a, b, d = s[:, 0, 0, None], s[:, 0, 1, None], s[:, 1, 1, None]
    distance = (d * x * x - 2.0 * b * x * y + a * y * y) / _determinant(s)[:, None]
    return Innovations(residual, s, np.maximum(distance, 0.0))


def update(states: Gaussians, seen: Innovations, beta: Array, noise: Array) -> Gaussians:
    """Take in the measurements with weights `beta` (n, m + 1), column 0 for none, each row summing to 1."""
    a, b, d = seen.covariance[:, 0, 0], seen.covariance[:, 0, 1], seen.covariance[:, 1, 1]
    inverse = (
        np.stack([d, -b, -b, a], axis=-1).reshape(-1, 2, 2) / _determinant(seen.covariance)[:, None, None]
    )
    gain = states.covariance[:, :, :2] @ inverse
    weighted = np.einsum("nm,nmk->nk", beta[:, 1:], seen.residual)
    # Around the weighted mean over all hypotheses, the missed one at zero included.
    around = seen.residual - weighted[:, None, :]
    spread = np.einsum("nm,nmk,nml->nkl", beta[:, 1:], around, around)
    spread += beta[:, 0, None, None] * weighted[:, :, None] * weighted[:, None, :]
    left = np.eye(STATE) - np.concatenate([gain, np.zeros((len(gain), STATE, STATE - 2))], axis=2)
    corrected = left @ states.covariance @ left.transpose(0, 2, 1) + gain @ noise @ gain.transpose(0, 2, 1)
    covariance = (
        beta[:, 0, None, None] * states.covariance
        + (1.0 - beta[:, 0, None, None]) * corrected
        + gain @ spread @ gain.transpose(0, 2, 1)
    )
    mean = states.mean + np.einsum("nkl,nl->nk", gain, weighted)
    return Gaussians(mean, 0.5 * (covariance + covariance.transpose(0, 2, 1)))


def _determinant(s: Array) -> Array:
    """Of symmetric 2 x 2 matrices (n, 2, 2), (n,)."""
    return np.maximum(s[:, 0, 0] * s[:, 1, 1] - s[:, 0, 1] ** 2, _LIKELY)
