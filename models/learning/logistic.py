"""Logistic regression with both classes weighing the same: its logit is a log likelihood ratio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RIDGE = 1e-2


@dataclass(frozen=True, slots=True)
class LogisticFit:
    """A logistic regression: logit = x @ weights + offset."""

    weights: NDArray[np.float64]
    offset: float


def equal_shares(y: NDArray[np.bool_]) -> NDArray[np.float64]:
    """What each example counts (n,), so that both classes weigh the same and all together 1."""
    return np.where(y, 0.5 / y.sum(), 0.5 / (~y).sum())


def logistic(
    x: NDArray[np.float64],
    y: NDArray[np.bool_],
    ridge: float = _RIDGE,
    towards: NDArray[np.float64] | None = None,
) -> LogisticFit:
    """Fit with both classes weighing the same and a ridge that pulls the weights `towards` some, or to zero.

    Raises ValueError where one class is missing.
    """
    if not y.any() or y.all():
        raise ValueError("both boxes with and boxes without the object are needed")
    weight = equal_shares(y)
    sign = np.where(y, 1.0, -1.0)

    # Loaded here: half of what a monitor would load, and only training needs it.
    from scipy.optimize import minimize
    from scipy.special import expit

    known = np.zeros(x.shape[1]) if towards is None else towards

    def loss(theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin, apart = sign * (x @ theta[:-1] + theta[-1]), theta[:-1] - known
        value = float(weight @ np.logaddexp(0.0, -margin)) + 0.5 * ridge * float(apart @ apart)
        slope = -weight * sign * expit(-margin)
        return value, np.append(x.T @ slope + ridge * apart, slope.sum())

    found = minimize(loss, np.append(known, 0.0), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return LogisticFit(found.x[:-1], float(found.x[-1]))
