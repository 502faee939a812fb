"""Arguments of the wrong shape are refused by name, with what was expected and what was given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lumpwatch.models import (
    AdaptiveSwitching,
    FixedSwitching,
    GridDensity,
    HistogramLikelihood,
    KernelBirths,
    MultiJdtFilter,
    NetworkLikelihood,
    PolygonBirths,
    RandomWalk,
    Roi,
    RowProfile,
    View,
    blank,
    default_profile,
    learn_density,
    learn_profile,
    make_roi,
    overlaps,
    polygon_births,
    stratified,
    systematic,
)
from lumpwatch.models.jdt import Step
from lumpwatch.models.jdt.motion import move_by_label
from lumpwatch.models.trackers.appearance import HistogramAppearance
from lumpwatch.models.trackers.imm_pf import ImmFilter
from tests.models.filters import DT, belief_of, make_filter
from tests.models.helpers import Seen, flat

EVEN = np.full(16, 1 / 16)
NEW = np.random.default_rng
TWO = np.array([[0.9, 0.1], [0.2, 0.8]])
NONE = np.array([False, False])
PROFILE = default_profile(80, 8, 12, 10)
MASK = np.ones((80, 100), np.uint8)


def region() -> Roi:
    return make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], width=100, height=80, working_size=100)


def given(*shape: int, dtype: Any = np.uint8) -> Any:
    return np.zeros(shape, dtype)


def density(models: int) -> GridDensity:
    return GridDensity((1,), np.zeros(1), np.ones(1), np.ones((models, 5)))


PARTS: list[tuple[str, Callable[[], object], str]] = [
    ("smaller picture", lambda: region().view(given(40, 50)), r"gray\) .*\(80, 100\), not \(40, 50\) of uint8"),
    ("colour as grey", lambda: region().view(given(80, 100, 3)), r"\(80, 100\), not \(80, 100, 3\)"),
    ("grey as colour", lambda: region().view(given(80, 100), given(80, 100)), r"colour\) .*\(80, 100, 3\), not"),
    ("float picture", lambda: region().view(given(80, 100, dtype=float)), "uint8, 0 to 255, not of float64"),
    ("list as picture", lambda: region().view([[1, 2]]), r"\(80, 100\), not list"),
    ("a view by hand", lambda: View(given(8, 8), None, given(8, 8, dtype=np.int32)), r"\(7, 7\), not \(8, 8\)"),
    ("one corner", lambda: make_roi([(0.0, 0.0)], 100, 80, 100), "three corners or more, not 1"),
    ("corners of three", lambda: make_roi(given(4, 3), 100, 80, 100), r"polygon .*\(k, 2\), not \(4, 3\)"),
    ("no square", lambda: FixedSwitching(TWO[:1], DT, NONE), r"square, not \(1, 2\)"),
    ("rows that do not sum", lambda: FixedSwitching(TWO * 2, DT, NONE), r"sum to 1, not to \[2\. 2\.\]"),
    ("momentary of three", lambda: FixedSwitching(TWO, DT, given(3, dtype=bool)), r"momentary .*\(2,\), not \(3,\)"),
    ("momentary as indices", lambda: FixedSwitching(TWO, DT, given(2, dtype=int)), "momentary .* not of int64"),
    ("no interval", lambda: FixedSwitching(TWO, 0.0, NONE), "interval_s must be positive"),
    ("density of three", lambda: AdaptiveSwitching(TWO, DT, NONE, density(3)), "the 2 models .* not of 3"),
    ("flat density", lambda: GridDensity((1,), np.zeros(1), np.ones(1), np.ones(5)), r"values .*\(models, n\), not"),
    ("births' sum", lambda: polygon_births(MASK, PROFILE, np.array([0.5, 0.6])), r"model_probabilities .*sum 1\.1"),
    ("births' sign", lambda: polygon_births(MASK, PROFILE, np.array([-0.5, 1.5])), "model_probabilities must be prob"),
    ("births' matrix", lambda: polygon_births(MASK, PROFILE, TWO), r"model_probabilities .*not \(2, 2\)"),
    ("colour mask", lambda: polygon_births(given(8, 8, 3), PROFILE, np.ones(1)), r"mask .*\(h, w\)"),
    ("pixels of three", lambda: PolygonBirths(given(5, 3), PROFILE, np.ones(1)), r"pixels .*\(k, 2\), not \(5, 3\)"),
    ("places", lambda: KernelBirths(given(5, 3), np.ones(2), births()), r"places .*\(k, 2\), not \(5, 3\)"),
    ("bandwidth", lambda: KernelBirths(given(5, 2), np.ones(1), births()), r"bandwidth .*\(2,\), not \(1,\)"),
    ("profile of two", lambda: RowProfile(0.0, 1.0, np.ones((3, 2)), np.ones((3, 2))), r"mean .*\(rows, 4\)"),
    ("NaN profile", lambda: RowProfile(0.0, 1.0, np.full((3, 4), np.nan), np.ones((3, 4))), "mean must be finite"),
    ("sizes turned round", lambda: default_profile(80, 12, 8, 10), "smallest and largest"),
    ("reference of eight", lambda: HistogramLikelihood(EVEN[:8], 1, 1, 1, 1), r"reference .*\(16,\), not \(8,\)"),
    ("reference as counts", lambda: HistogramLikelihood(EVEN * 64, 1, 1, 1, 1), r"reference .*sum 64"),
    ("unknown channel", lambda: HistogramLikelihood(EVEN, 1, 1, 1, 1, "grey"), "'luma' or 'colour', not 'grey'"),
    ("NaN slope", lambda: HistogramLikelihood(EVEN, 1, np.nan, 1, 1), "slope must be finite"),
    ("map of three axes", lambda: of_network(given(2, 3, 4)), r"shape \(2, 3, 4\) where a map"),
    ("three models' matrix", lambda: make_filter(np.eye(3).tolist(), (RandomWalk("a", 1.0),) * 2),
     r"matrix .*2 models.*\(2, 2\), not \(3, 3\)"),
    ("births of two", lambda: replace(make_filter(), births=births(2)), r"births, for 1 models.*\(1,\), not \(2,\)"),
    ("no models", lambda: replace(make_filter(), models=()), "one motion model or more"),
    ("unknown form", lambda: replace(make_filter(), form="marginl"), "'marginal' or 'sampled', not 'marginl'"),  # type: ignore[arg-type]
    ("unknown order", lambda: replace(make_filter(), order="first"), "order must be"),  # type: ignore[arg-type]
    ("no particles", lambda: make_filter(particles=0), "particles must be 2 or more"),
    ("all newborn", lambda: replace(make_filter(), born_share=1.0), "born_share"),
    ("no tracks", lambda: MultiJdtFilter(make_filter(), most=0), "most and track_particles"),
    ("births' seed", lambda: births().draw(5, 1), r"rng must be a numpy.random.Generator .* not int 1"),
    ("start's seed", lambda: make_filter().start(1), "rng must be a numpy.random.Generator"),  # type: ignore[arg-type]
    ("resampling's seed", lambda: systematic(np.ones(5), 5, 1), "rng must be"),
    ("weights of two axes", lambda: stratified(np.ones((5, 2)), 5, NEW(1)), r"weights .*\(m,\), not \(5, 2\)"),
    ("motion's states", lambda: RandomWalk("a", 1.0).move(np.ones((3, 4)), DT, NEW(1)),
     r"states .*\(n, 8\), not \(3, 4\)"),
    ("motion's seed", lambda: RandomWalk("a", 1.0).move(blank(3), DT, 1), "rng must be"),
    ("motion's answer", lambda: move_by_label([Short()], blank(3), np.zeros(3, int), DT, NEW(1)),
     r"model short gives .*\(3, 8\), not \(1, 8\)"),
    ("profile's states", lambda: learn_profile(np.ones((3, 4)), 80), r"states .*\(n, 8\), not \(3, 4\)"),
    ("density's labels", lambda: learn_density(blank(3), np.zeros(2, int), 1, (1,), 1.0),
     r"labels .*\(3,\), not \(2,\)"),
    ("boxes of three", lambda: overlaps(np.ones((2, 4)), np.ones((2, 3))), r"b must .*\(m, 4\), not \(2, 3\)"),
    ("one box", lambda: overlaps(np.ones(4), np.ones((2, 4))), r"a must .*\(n, 4\), not \(4,\)"),
    ("IMM's mean", lambda: imm().start(np.zeros(4), np.ones(8), NEW(1)), r"mean .*\(8,\), not \(4,\)"),
    ("IMM's NaN", lambda: imm().start(np.full(8, np.nan), np.ones(8), NEW(1)), "mean must be finite"),
    ("IMM's seed", lambda: imm().start(np.zeros(8), np.ones(8), 1), "rng must be"),  # type: ignore[arg-type]
    ("IMM's states", lambda: corrected(blank(3), np.zeros(200)), r"states .*\(200, 8\), not \(3, 8\)"),
    ("IMM's likelihood", lambda: corrected(blank(200), np.zeros(3)), r"log_likelihood .*\(200,\), not \(3,\)"),
    ("IMM's NaN likelihood", lambda: corrected(blank(200), np.full(200, np.nan)), "log_likelihood is NaN"),
    ("IMM's one NaN", lambda: corrected(blank(200), np.r_[np.nan, np.zeros(199)]), "log_likelihood is NaN"),
]  # fmt: skip


class Short:
    """A motion model that loses states."""

    name, momentary = "short", False

    def move(self, states: Any, dt: float, rng: object) -> Any:
        return states[:1]


def births(models: int = 1) -> PolygonBirths:
    return polygon_births(MASK, PROFILE, np.full(models, 1 / models))


def imm() -> ImmFilter:
    return ImmFilter((RandomWalk("walk", 1.0),))


def corrected(states: Any, log_likelihood: Any) -> object:
    return imm().correct(imm().start(np.zeros(8), np.ones(8), NEW(1)), states, log_likelihood)


def of_network(logits: Any) -> object:
    return NetworkLikelihood(lambda _: logits, 0.0, 1.0, 1.0).observe(region().view(given(80, 100)))


@pytest.mark.parametrize(("make", "says"), [part[1:] for part in PARTS], ids=[part[0] for part in PARTS])
def test_what_does_not_fit_is_named(make: Callable[[], object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make()


def stepped(rng: Any = None, observation: Any = None, switching: Any = None, **changed: Any) -> Step:
    jdt = make_filter(particles=50)
    if switching is not None:
        jdt = replace(jdt, switching=switching)
    belief = replace(belief_of(jdt, 0.5), **changed)
    return jdt.step(
        belief, flat(1.0) if observation is None else observation, DT, NEW(1) if rng is None else rng
    )


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"rng": 7}, "rng must be a numpy.random.Generator .* not int 7"),
        ({"states": np.zeros((35, 4))}, r"belief.states .*\(n, 8\), not \(35, 4\)"),
        ({"states": np.full((35, 8), np.nan)}, "belief.states must be finite; 35 of 35"),
        ({"labels": np.zeros(3, np.intp)}, r"belief.labels .*\(35,\), not \(3,\)"),
        ({"labels": np.full(35, 1)}, "belief.labels must be from 0 to 0"),
        ({"labels": np.full(35, -1)}, "belief.labels must be from 0 to 0"),
        ({"labels": np.zeros(35)}, "belief.labels must be whole numbers"),
        ({"exists": np.ones(3, np.bool_)}, r"belief.exists .*\(35,\), not \(3,\)"),
        ({"existence": float("nan")}, "belief.existence must be a probability, not nan"),
        ({"existence": 1.5}, "belief.existence must be a probability, not 1.5"),
        ({"observation": given(80, 100)}, "observe gives, not"),
        ({"observation": Seen(lambda states: np.zeros((len(states), 1)))}, r"log_ratio gives .*\(50,\), not \(50, 1\)"),
        ({"observation": Seen(lambda states: np.full(len(states), np.nan))}, "log_ratio gives NaN"),
        ({"observation": Seen(lambda states: np.r_[np.nan, np.zeros(len(states) - 1)])}, "log_ratio gives NaN"),
        ({"observation": Seen(lambda states: np.full(len(states), np.inf))}, "NaN or .inf"),
    ],
)  # fmt: skip
def test_a_step_names_what_does_not_fit(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        stepped(**changed)


def test_one_state_that_is_no_number_is_found() -> None:
    states = belief_of(make_filter(particles=50), 0.5).states.copy()
    states[7, 0] = np.nan
    with pytest.raises(ValueError, match=r"belief\.states must be finite; 1 of 35"):
        stepped(states=states)


def test_a_motion_model_that_gives_nan_is_found() -> None:
    class Broken:
        name, momentary = "broken", False

        def move(self, states: Any, dt: float, rng: object) -> Any:
            return states * np.nan

    jdt = make_filter(models=(Broken(),), particles=50)
    with pytest.raises(ValueError, match="a motion model or births gave states that are not finite"):
        jdt.step(belief_of(jdt, 0.5), flat(1.0), DT, NEW(1))


def test_a_switching_of_ones_own_of_another_number_of_models_is_found() -> None:
    class Own:
        def rows(self, states: Any, labels: Any, dt: float) -> Any:
            return np.full((len(states), 2), 0.5), np.zeros(len(states), np.bool_)

    with pytest.raises(ValueError, match=r"switching.rows gives .*\(35, 1\), not \(35, 2\)"):
        stepped(switching=Own())


def test_lists_are_taken_as_arrays() -> None:
    switching = FixedSwitching(TWO.tolist(), DT, [False, True])
    rows, _ = switching.rows(blank(2), np.array([0, 1]), DT)
    assert np.array_equal(rows, TWO)


def test_a_run_is_its_steps() -> None:
    jdt, rng = make_filter(particles=200), NEW(3)
    likelihood = HistogramLikelihood(EVEN, 1.0, 2.0, 1.0, 3.0)
    pictures = list(NEW(2).integers(0, 256, (4, 80, 100), dtype=np.uint8))
    belief, wanted = jdt.start(rng), []
    for picture in pictures:
        step = jdt.step(belief, likelihood.observe(region().view(picture)), DT, rng)
        belief = step.belief
        wanted.append(belief.existence)
    ran = list(jdt.run(pictures, region(), likelihood, DT, NEW(3)))
    assert [step.belief.existence for step in ran] == wanted
    rng = NEW(3)
    first = list(jdt.run(pictures[:2], region(), likelihood, DT, rng))
    rest = list(jdt.run(pictures[2:], region(), likelihood, DT, rng, first[-1].belief))
    assert [step.belief.existence for step in first + rest] == wanted


def test_a_run_over_colour_pictures_sees_their_colour() -> None:
    likelihood = HistogramLikelihood(EVEN, 1.0, 2.0, 1.0, 3.0, "colour")
    coloured = NEW(2).integers(0, 256, (2, 80, 100, 3), dtype=np.uint8)
    jdt = make_filter(particles=50)
    assert len(list(jdt.run(coloured, region(), likelihood, DT, NEW(1)))) == 2
    with pytest.raises(ValueError, match="needs colour"):
        list(jdt.run(coloured[..., 0], region(), likelihood, DT, NEW(1)))


def test_a_run_names_the_picture_that_does_not_fit() -> None:
    jdt, likelihood = make_filter(particles=50), HistogramLikelihood(EVEN, 1.0, 2.0, 1.0, 3.0)
    for last in (given(40, 50), given(40, 50, 3), given(80, 100, 4)):
        with pytest.raises(ValueError, match=r"picture 1: the picture .*\(80, 100(, 3)?\), not \("):
            list(jdt.run([given(80, 100), last], region(), likelihood, DT, NEW(1)))


def test_several_objects_run_too() -> None:
    multi = MultiJdtFilter(make_filter(particles=100))
    likelihood = HistogramLikelihood(np.eye(16)[0], 3.0, 4.0, 1.0, 3.0)
    pictures = [given(80, 100)] * 3
    ran = list(
        multi.run(pictures, region(), likelihood, DT, NEW(1), appearance=HistogramAppearance().observe)
    )
    assert len(ran) == 3
    with pytest.raises(ValueError, match="rng must be"):
        multi.step(multi.start(NEW(1)), flat(0.0), None, DT, 1)


@pytest.mark.parametrize("dt", [0.0, -0.1, float("nan"), [0.1, 0.1], None])
def test_a_time_step_is_a_positive_number(dt: Any) -> None:
    jdt, likelihood = make_filter(particles=50), HistogramLikelihood(EVEN, 1.0, 2.0, 1.0, 3.0)
    with pytest.raises(ValueError, match="dt must be positive and finite, not"):
        list(jdt.run([given(80, 100)], region(), likelihood, dt, NEW(1)))


def test_noise_and_height_have_a_sign() -> None:
    with pytest.raises(ValueError, match="position_noise of RandomWalk must not be negative, not -1"):
        RandomWalk("walk", -1.0)
    with pytest.raises(ValueError, match="height must be positive and finite, not -80"):
        default_profile(-80, 8, 12, 10)
