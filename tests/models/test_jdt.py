"""The filter's existence, labels, estimate and refusals, where the answer is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.births import PolygonBirths, polygon_births
from models.existence import ExistenceChain
from models.jdt import Form, JdtFilter, Order
from models.motion import (
    Bounce,
    ConstantAcceleration,
    ConstantVelocity,
    FreeAcceleration,
    MotionModel,
    RandomWalk,
)
from models.profile import RowProfile
from models.state import Belief, H, Labels, States, W, X, Y
from models.switching import FixedSwitching
from tests.models.helpers import Marker, Seen, births_over, boxes, flat, flat_profile

Array = NDArray[np.float64]
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
        flat_profile((0.0, 0.0, 0.0, 0.0)),
        chain,
        particles=particles,
        form=form,
        order=order,
    )


def belief_of(
    jdt: JdtFilter, existence: float, states: States | None = None, labels: Labels | None = None
) -> Belief:
    """A belief of the size that the filter carries on, all in the middle unless told otherwise."""
    n = jdt.particles - round(jdt.particles * jdt.born_share) if jdt.form == "marginal" else jdt.particles
    states = boxes(n, 50, 40) if states is None else states
    labels = np.zeros(n, np.intp) if labels is None else labels
    alive = n if jdt.form == "marginal" else round(n * existence)
    return Belief(states, labels, np.arange(n) < alive, existence)


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


SHARES = np.array([[0.95, 0.05], [0.2, 0.8]])


@both_orders
@both_forms
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (0.2, 0.2),  # the stationary share of the matrix: 0.8 * 0.05 + 0.2 * 0.8 = 0.2
        (0.0, 0.05),  # the matrix once; twice would give 0.05 * 0.95 + 0.05 * 0.8 = 0.0875
        (1.0, 0.8),  # twice would give 0.8 * 0.8 + 0.2 * 0.05 = 0.65
    ],
)
def test_flat_likelihood_moves_model_shares_by_the_matrix_once(
    form: Form, order: Order, before: float, after: float
) -> None:
    """Over 20,000 particles (14,000 survivors in the marginal form) a share has a standard error of at
    most sqrt(0.16 / 14000) = 0.0034; the bound is five of them."""
    jdt = make_filter(SHARES.tolist(), particles=20_000, form=form, order=order)
    belief = belief_of(jdt, 1.0)
    labels = (np.arange(len(belief.labels)) < before * len(belief.labels)).astype(np.intp)
    step = jdt.step(replace(belief, labels=labels), flat(0.3), DT, np.random.default_rng(3))
    assert step.belief.labels.mean() == pytest.approx(after, abs=0.017)
    assert step.estimate is not None
    assert step.estimate.model_shares == pytest.approx([1 - after, after], abs=0.017)


@both_forms
@pytest.mark.parametrize(("order", "expected"), [("model_first", 1.0), ("state_first", 0.0)])
def test_order_decides_which_model_moves(form: Form, order: Order, expected: float) -> None:
    """The chain goes from model 0 to model 1 for certain: the state is moved by 1 or, as Eq. 9 has it, by 0.
    The label afterwards is 1 in both."""
    markers = (Marker("zero", 0.0), Marker("one", 1.0))
    jdt = make_filter([[0.0, 1.0], [1.0, 0.0]], markers, form=form, order=order)
    belief = jdt.step(belief_of(jdt, 1.0), flat(0.0), DT, np.random.default_rng(0)).belief
    assert np.all(belief.states[:, X] == expected)
    assert np.all(belief.labels == 1)


@both_forms
def test_estimate_stays_with_one_of_two_candidates(form: Form) -> None:
    """Three quarters of the weight at x = 20, a quarter at x = 80: not the mean of 35."""
    jdt = make_filter(form=form)
    belief = belief_of(jdt, 1.0)
    # One group after the other: in alternation the regular comb of resampling would beat with them.
    belief.states[:, X] = np.where(np.arange(len(belief.states)) < len(belief.states) / 2, 20.0, 80.0)
    seen = Seen(lambda states: np.where(states[:, X] < 50, np.log(3.0), 0.0))
    step = jdt.step(belief, seen, DT, np.random.default_rng(0))
    assert step.estimate is not None
    assert step.estimate.mean[X] == pytest.approx(20.0, abs=1e-6)
    assert step.estimate.spread[X] == pytest.approx(0.0, abs=1e-3)
    assert step.estimate.mean[[W, H]] == pytest.approx([10.0, 10.0], rel=0.01)
    assert np.mean(step.belief.states[:, X] < 50) == pytest.approx(0.75, abs=0.01)


def test_estimate_spread_of_one_mode() -> None:
    """Half the particles at 49 and half at 51: mean 50 and spread 1."""
    jdt = make_filter()
    belief = belief_of(jdt, 1.0)
    belief.states[:, X] = 49.0 + 2.0 * (np.arange(len(belief.states)) % 2)
    step = jdt.step(belief, flat(0.0), DT, np.random.default_rng(0))
    assert step.estimate is not None
    assert step.estimate.mean[X] == pytest.approx(50.0, abs=1e-6)
    assert step.estimate.spread[X] == pytest.approx(1.0, abs=1e-6)
    assert step.estimate.model_shares == pytest.approx([1.0])


def test_nobody_alive_gives_no_estimate() -> None:
    jdt = make_filter(form="sampled")
    step = jdt.step(belief_of(jdt, 0.0), flat(2.0), DT, np.random.default_rng(0))
    assert step.estimate is None
    assert step.belief.existence == 0.0
    assert step.diagnostics.effective_particles == 0.0


def test_effective_particles_by_hand() -> None:
    """1400 survivors share the weight, newborn ones have none; then half of them lose theirs."""
    jdt = make_filter()
    belief = belief_of(jdt, 1.0)
    belief.states[:, X] = np.where(np.arange(len(belief.states)) % 2, 20.0, 80.0)
    rng = np.random.default_rng(0)
    everywhere = jdt.step(belief, flat(0.0), DT, rng).diagnostics
    assert everywhere.effective_particles == pytest.approx(1400, rel=1e-6)
    left = Seen(lambda states: np.where(states[:, X] < 50, 0.0, -50.0))
    assert jdt.step(belief, left, DT, rng).diagnostics.effective_particles == pytest.approx(700, rel=1e-6)


def test_sizes_follow_the_row() -> None:
    """Expected sizes double from row 0 to row 80 (log 2 apart): so does an object that falls that far.
    Sizes also breathe by 5 % in a second; the mean over 1400 particles is within 1 %."""
    two = np.log(2.0)
    profile = RowProfile(0.0, 80.0, np.array([[0, 0, 0, 0], [0, 0, two, two]]), np.zeros((2, 4)))
    jdt = replace(make_filter(models=(ConstantVelocity("fall", 0.0),)), profile=profile)
    belief = belief_of(jdt, 1.0)
    belief.states[:, Y], belief.states[:, 3] = 0.0, 80.0
    after = jdt.step(belief, flat(0.0), 1.0, np.random.default_rng(0)).belief.states
    assert np.allclose(after[:, Y], 80.0)
    assert after[:, [W, H]].mean(axis=0) == pytest.approx([20.0, 20.0], rel=0.01)


@both_orders
@both_forms
def test_same_seed_same_bytes(form: Form, order: Order) -> None:
    models = (ConstantVelocity("slow", 5.0), FreeAcceleration("fast", 30.0))
    jdt = make_filter(SHARES.tolist(), models, ExistenceChain(1.0, 0.5), form=form, order=order)
    seen = Seen(lambda states: 2.0 - 0.05 * np.abs(states[:, X] - 40))

    def run(seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        belief = jdt.start(rng)
        for _ in range(5):
            belief = jdt.step(belief, seen, DT, rng).belief
        parts = (belief.states, belief.labels, belief.exists, np.array(belief.existence))
        return b"".join(part.tobytes() for part in parts)

    assert run(11) == run(11)
    assert run(11) != run(12)


@both_forms
def test_step_does_not_change_the_belief_before(form: Form) -> None:
    jdt = make_filter(chain=ExistenceChain(1.0, 1.0), form=form)
    belief = belief_of(jdt, 0.5)
    for part in (belief.states, belief.labels, belief.exists):
        part.setflags(write=False)
    jdt.step(belief, flat(1.0), DT, np.random.default_rng(0))


@both_forms
@pytest.mark.parametrize("dt", [0.0, -0.04, np.nan, np.inf])
def test_bad_time_steps_are_refused(form: Form, dt: float) -> None:
    jdt = make_filter(form=form)
    with pytest.raises(ValueError, match="dt must be positive"):
        jdt.step(belief_of(jdt, 0.5), flat(0.0), dt, np.random.default_rng(0))


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


@dataclass(frozen=True)
class Enlarged:
    """Births in a picture that is twice as large, from the same random numbers."""

    inner: PolygonBirths

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        states, labels = self.inner.draw(n, rng)
        return states * 2.0, labels


SMALL = (
    ConstantVelocity("belt", 6.0),
    ConstantAcceleration("fall", (3.0, 50.0), 20.0),
    Bounce("wall", 4.0, along_x=True, along_y=False),
)
LARGE = (
    ConstantVelocity("belt", 12.0),
    ConstantAcceleration("fall", (6.0, 100.0), 40.0),
    Bounce("wall", 8.0, along_x=True, along_y=False),
)


@both_orders
@both_forms
def test_everything_twice_as_large_is_the_same_scene(form: Form, order: Order) -> None:
    """All lengths doubled, the likelihood too: the same existence and doubled states for the same seed."""
    matrix = np.array([[0.9, 0.05, 0.05], [0.1, 0.85, 0.05], [0.5, 0.5, 0.0]])
    profile = RowProfile(
        0.0, 40.0, np.array([[0, 5, 2, 2], [0, 9, 2.5, 2.5]], float), np.tile([2.0, 4.0, 0.1, 0.1], (2, 1))
    )
    births = polygon_births(np.ones((40, 60), np.uint8), profile, np.array([0.8, 0.2, 0.0]))
    small = JdtFilter(
        SMALL,
        FixedSwitching(matrix, DT, np.array([False, False, True])),
        births,
        profile,
        ExistenceChain(2.0, 1.0),
        particles=400,
        form=form,
        order=order,
    )
    twice: PolygonBirths = Enlarged(births)  # type: ignore[assignment]
    large = replace(small, models=LARGE, births=twice, profile=profile.scaled(2.0))

    def around(t: int, factor: float) -> Callable[[States], Array]:
        place = np.array([30.0, 10.0 + t]) * factor
        return lambda states: 3.0 - 0.02 * np.square((states[:, [X, Y]] - place) / factor).sum(axis=1)

    rngs = np.random.default_rng(4), np.random.default_rng(4)
    a, b = small.start(rngs[0]), large.start(rngs[1])
    for t in range(12):
        a = small.step(a, Seen(around(t, 1.0)), DT, rngs[0]).belief
        b = large.step(b, Seen(around(t, 2.0)), DT, rngs[1]).belief
        assert b.existence == pytest.approx(a.existence, abs=1e-9)
        assert np.array_equal(a.labels, b.labels)
        assert np.allclose(b.states, 2.0 * a.states, rtol=1e-9, atol=1e-9)
    assert a.existence > 0.5
    assert set(a.labels) == {0, 1, 2}
