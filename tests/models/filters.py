"""A joint detection and tracking filter over a plain scene, to be varied by the tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form, JdtFilter, Order
from lumpwatch.models.jdt.motion import MotionModel, RandomWalk
from lumpwatch.models.jdt.switching import FixedSwitching
from lumpwatch.models.state import Belief
from tests.models.helpers import births_over, boxes, flat_profile

FORMS: tuple[Form, ...] = ("marginal", "sampled")
ORDERS: tuple[Order, ...] = ("model_first", "state_first")
NEVER = ExistenceChain(1e-12, 1e-12)
DT = 0.04

both_forms = pytest.mark.parametrize("form", FORMS)
both_orders = pytest.mark.parametrize("order", ORDERS)


def make_filter(
    matrix: Sequence[Sequence[float]] = ((1.0,),),
    models: tuple[MotionModel, ...] | None = None,
    chain: ExistenceChain = NEVER,
    particles: int = 2000,
    form: Form = "marginal",
    order: Order = "model_first",
) -> JdtFilter:
    """A filter over 100 x 80 px whose models, unless given, leave every state where it is."""
    regimes = len(matrix)
    models = models or tuple(RandomWalk(f"still {m}", 0.0) for m in range(regimes))
    return JdtFilter(
        models,
        FixedSwitching(np.array(matrix), DT, np.zeros(regimes, np.bool_)),
        births_over(100, 80, (1.0,) + (0.0,) * (regimes - 1)),
        flat_profile((0.0, 0.0, float(np.log(10.0)), float(np.log(10.0)))),
        chain,
        particles=particles,
        form=form,
        order=order,
    )


def belief_of(jdt: JdtFilter, existence: float) -> Belief:
    """A belief of the size that the filter carries on, all in the middle under the first model."""
    n = jdt.particles - round(jdt.particles * jdt.born_share) if jdt.form == "marginal" else jdt.particles
    alive = n if jdt.form == "marginal" else round(n * existence)
    return Belief(boxes(n, 50, 40), np.zeros(n, np.intp), np.arange(n) < alive, existence)
