"""What the filter's doors refuse: parts that do not fit each other, beliefs and answers of the wrong shape.

Numbers that are no numbers are looked for where a step has found one in its result, so that a step without
them pays nothing for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.checks import check_shape
from lumpwatch.models.jdt.births import Births, KernelBirths, PolygonBirths
from lumpwatch.models.jdt.switching import AdaptiveSwitching, FixedSwitching, Switching
from lumpwatch.models.likelihood.base import Observation
from lumpwatch.models.state import SIZE, Belief, Estimate, States

_ROUNDING = 1e-9
"""A quotient of sums may pass 1 by the last digits."""


def check_parts(models: int, switching: Switching, births: Births) -> None:
    """Switching and births of as many models as there are; parts of a user's own show it at the first step."""
    if models == 0:
        raise ValueError("models must hold one motion model or more")
    if isinstance(switching, FixedSwitching | AdaptiveSwitching):
        check_shape(switching.matrix, (models, models), f"the matrix of switching, for {models} models,")
    anywhere = births.anywhere if isinstance(births, KernelBirths) else births
    if isinstance(anywhere, PolygonBirths):
        check_shape(
            anywhere.model_probabilities, (models,), f"model_probabilities of births, for {models} models,"
        )


def check_belief(belief: Belief, models: int) -> None:
    """States (n, 8), with labels of these models and existence (n,) each."""
    if not isinstance(belief, Belief):
        raise ValueError(  # noqa: TRY004  what a user gave is a value
            f"belief must be a Belief (start gives one), not {type(belief).__name__}"
        )
    check_shape(belief.states, ("n", SIZE), "belief.states")
    n = len(belief.states)
    check_shape(belief.labels, (n,), "belief.labels")
    check_shape(belief.exists, (n,), "belief.exists")
    if belief.exists.dtype != np.bool_ or belief.labels.dtype.kind not in "iu":
        raise ValueError(
            "belief.labels must be whole numbers and belief.exists true or false, "
            f"not {belief.labels.dtype} and {belief.exists.dtype}"
        )
    if not -_ROUNDING <= belief.existence <= 1.0 + _ROUNDING:
        raise ValueError(f"belief.existence must be a probability, not {belief.existence}")
    if n and not 0 <= belief.labels.min() <= belief.labels.max() < models:
        raise ValueError(f"belief.labels must be from 0 to {models - 1}, the index of a motion model")


def log_ratio_of(observation: Observation, states: States) -> NDArray[np.float64]:
    """What the observation says of the states (n, 8), as (n,)."""
    if not hasattr(observation, "log_ratio"):
        raise ValueError(
            f"observation must be what a likelihood's observe gives, not {type(observation).__name__}"
        )
    ratio = observation.log_ratio(states)
    check_shape(ratio, (len(states),), "what observation.log_ratio gives")
    return ratio


def check_cause(belief: Belief, estimate: Estimate | None) -> None:
    """Say where a number that is none came from, where one is seen in a step's result."""
    wrong = int((~np.isfinite(belief.states[belief.exists]).all(axis=1)).sum())
    if wrong:
        raise ValueError(f"belief.states must be finite; {wrong} of {len(belief.states)} states are not")
    if estimate is not None and not np.isfinite(estimate.mean).all():
        raise ValueError("a motion model or births gave states that are not finite")
