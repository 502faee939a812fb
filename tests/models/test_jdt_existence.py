"""The filter's existence where the answer is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form, Order
from tests.models.filters import DT, belief_of, both_forms, both_orders, make_filter
from tests.models.helpers import flat


@both_orders
@both_forms
def test_no_evidence_lowers_existence(form: Form, order: Order) -> None:
    """Prior 0.9 and p_D = 0.9: nothing seen has the ratio 0.1, so 0.09 / (0.09 + 0.1) = 0.473684.
    In the sampled form the 1800 particles of 0.1 and 200 of 1 leave 947 or 948 of 2000 alive."""
    jdt = make_filter(form=form, order=order)
    step = jdt.step(belief_of(jdt, 0.9), flat(np.log(0.1)), DT, np.random.default_rng(0))
    tolerance = 1e-9 if form == "marginal" else 1 / 2000
    assert step.belief.existence == pytest.approx(0.473684, abs=tolerance + 1e-6)


@both_forms
def test_no_evidence_with_births_and_deaths(form: Form) -> None:
    """Prediction (1 - P_d) 0.9 + P_b 0.1, then the same update. The sampled chain draws 2000 fates: six
    standard errors of a frequency are at most 6 * 0.5 / sqrt(2000) = 0.067, a wrong chain is 0.2 off."""
    jdt = make_filter(chain=ExistenceChain(2.0, 10.0), form=form)
    mixed = 1 - np.exp(-12.0 * DT)
    predicted = (1 - 10 / 12 * mixed) * 0.9 + 2 / 12 * mixed * 0.1
    expected = 0.1 * predicted / (0.1 * predicted + 1 - predicted)
    step = jdt.step(belief_of(jdt, 0.9), flat(np.log(0.1)), DT, np.random.default_rng(0))
    assert step.belief.existence == pytest.approx(expected, abs=1e-9 if form == "marginal" else 0.067)


@settings(max_examples=50, deadline=None)
@given(
    existence=st.floats(0, 1),
    log_ratio=st.floats(-8, 8),
    birth=st.floats(1e-3, 5),
    death=st.floats(1e-3, 5),
    dt=st.floats(1e-3, 2),
)
def test_flat_evidence_is_the_two_state_filter(
    existence: float, log_ratio: float, birth: float, death: float, dt: float
) -> None:
    """Evidence that does not depend on the state leaves Bayes' rule on existence alone."""
    jdt = make_filter(chain=ExistenceChain(birth, death), particles=100)
    p_birth, p_death = jdt.chain.probabilities(dt)
    predicted = (1 - p_death) * existence + p_birth * (1 - existence)
    ratio = np.exp(log_ratio)
    step = jdt.step(belief_of(jdt, existence), flat(log_ratio), dt, np.random.default_rng(0))
    expected = ratio * predicted / (ratio * predicted + 1 - predicted)
    assert step.belief.existence == pytest.approx(expected, abs=1e-9)


def test_existence_does_not_depend_on_the_frame_rate() -> None:
    """Without evidence, ten steps of 0.1 s equal one of 1 s."""
    jdt = make_filter(chain=ExistenceChain(0.4, 0.7))
    rng = np.random.default_rng(0)
    fine = belief_of(jdt, 0.3)
    for _ in range(10):
        fine = jdt.step(fine, flat(0.0), 0.1, rng).belief
    coarse = jdt.step(belief_of(jdt, 0.3), flat(0.0), 1.0, rng).belief
    assert fine.existence == pytest.approx(coarse.existence, abs=1e-12)


@both_forms
def test_start_knows_of_no_object(form: Form) -> None:
    jdt = make_filter(chain=ExistenceChain(0.5, 0.5), form=form)
    belief = jdt.start(np.random.default_rng(0))
    assert belief.existence == 0.0
    assert len(belief.states) == len(belief.labels) == len(belief.exists)
    step = jdt.step(belief, flat(0.0), DT, np.random.default_rng(1))
    p_birth, _ = jdt.chain.probabilities(DT)
    # 2000 fates of the sampled form: six standard errors of sqrt(0.02 / 2000).
    assert step.belief.existence == pytest.approx(p_birth, abs=1e-12 if form == "marginal" else 0.02)


@both_forms
def test_number_of_particles_stays(form: Form) -> None:
    jdt = make_filter(chain=ExistenceChain(1.0, 1.0), particles=101, form=form)
    rng = np.random.default_rng(0)
    belief = jdt.start(rng)
    n = len(belief.states)
    for _ in range(20):
        belief = jdt.step(belief, flat(1.0), DT, rng).belief
        assert belief.states.shape == (n, 8)
        assert belief.exists.mean() == (1.0 if form == "marginal" else belief.existence)


@both_forms
@pytest.mark.parametrize("existence", [0.5, 1.0])
def test_object_impossible_everywhere(form: Form, existence: float) -> None:
    """A ratio of zero at every state means that there is no object; it is not an error, and the search
    goes on."""
    jdt = make_filter(chain=ExistenceChain(1.0, 1.0), form=form)
    rng = np.random.default_rng(0)
    before = belief_of(jdt, existence)
    step = jdt.step(before, flat(-np.inf), DT, rng)
    assert step.belief.existence == 0.0
    assert step.estimate is None
    assert step.belief.states.shape == before.states.shape
    assert jdt.step(step.belief, flat(3.0), DT, rng).belief.existence > 0.1


@both_forms
@pytest.mark.parametrize("log_ratio", [40.0, 800.0])
def test_overwhelming_evidence(form: Form, log_ratio: float) -> None:
    """exp(800) is beyond a float, yet the posterior is plain: the object is there."""
    jdt = make_filter(form=form)
    step = jdt.step(belief_of(jdt, 0.5), flat(log_ratio), DT, np.random.default_rng(0))
    assert step.belief.existence == pytest.approx(1.0)
