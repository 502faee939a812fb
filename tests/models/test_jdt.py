"""The filter's labels, states and estimate where the answer is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form, JdtFilter, Order
from lumpwatch.models.jdt.motion import Bounce, ConstantAcceleration, ConstantVelocity, FreeAcceleration
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.jdt.switching import FixedSwitching
from lumpwatch.models.state import H, Labels, States, W, X, Y, blank
from tests.models.filters import DT, belief_of, both_forms, both_orders, make_filter
from tests.models.helpers import Marker, Seen, flat

Array = NDArray[np.float64]
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
    """Expected sizes double from row 0 to row 80 (log 2 apart): so does an object that falls that far."""
    ten, two = np.log(10.0), np.log(2.0)
    mean = np.array([[0, 0, ten, ten], [0, 0, ten + two, ten + two]])
    profile = RowProfile(0.0, 80.0, mean, np.zeros((2, 4)))
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


def test_a_belief_without_room_for_newborn_particles_is_refused() -> None:
    jdt = make_filter(form="marginal")
    full = replace(belief_of(jdt, 0.5), states=blank(jdt.particles))
    with pytest.raises(ValueError, match=f"the belief has {jdt.particles} particles"):
        jdt.step(full, flat(1.0), DT, np.random.default_rng(0))


@both_forms
@pytest.mark.parametrize("dt", [0.0, -0.04, np.nan, np.inf])
def test_bad_time_steps_are_refused(form: Form, dt: float) -> None:
    jdt = make_filter(form=form)
    with pytest.raises(ValueError, match="dt must be positive"):
        jdt.step(belief_of(jdt, 0.5), flat(0.0), dt, np.random.default_rng(0))


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
