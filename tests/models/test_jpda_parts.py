"""Colour, zones, headings, regions cut in two, and boxes at the edge of the picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.trackers.jpda import ColourOptions, JpdaOptions, OneWay
from lumpwatch.models.trackers.jpda.colour import distances, histograms, ratio
from lumpwatch.models.trackers.jpda.edges import centres
from lumpwatch.models.trackers.jpda.splitting import split
from lumpwatch.models.trackers.jpda.zones import Heading, follow, inside

SQUARE = ((10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0))


def test_histogram_of_two_halves_by_hand() -> None:
    """The upper half is blue, the lower half one quarter green and the rest red."""
    picture = np.zeros((20, 20, 3), np.uint8)
    picture[4:8, 4:12] = 255, 0, 0
    picture[8:12, 4:12] = 0, 0, 255
    picture[8:12, 4:6] = 0, 255, 0
    found = histograms(picture, np.array([[8.0, 8.0, 8.0, 8.0]]), bins=2)
    assert found.shape == (1, 2, 8)
    assert found[0, 0].tolist() == [0, 0, 0, 0, 1, 0, 0, 0]  # blue is the first bit of three
    assert found[0, 1].tolist() == [0, 0.75, 0.25, 0, 0, 0, 0, 0]


def test_gray_picture_and_boxes_over_the_edge() -> None:
    picture = np.full((10, 10), 200, np.uint8)
    found = histograms(picture, np.array([[0.0, 5.0, 8.0, 6.0], [50.0, 50.0, 4.0, 4.0]]), bins=4)
    assert found[0].tolist() == [[0, 0, 0, 1], [0, 0, 0, 1]]
    assert found[1].tolist() == [[0.25] * 4] * 2  # not in the picture: nothing is known


def test_distances_by_hand() -> None:
    """rho = sqrt(0.5 * 1) above, 1 below: d^2 = 1 - 0.7071 in sum; nothing in common: 2."""
    one = np.array([[[0.5, 0.5], [1.0, 0.0]]])
    other = np.array([[[1.0, 0.0], [1.0, 0.0]], [[0.5, 0.5], [1.0, 0.0]]])
    assert distances(one, other) == pytest.approx(np.array([[1.0 - np.sqrt(0.5), 0.0]]))
    assert distances(np.array([[[1.0, 0.0]] * 2]), np.array([[[0.0, 1.0]] * 2])) == pytest.approx(2.0)


def test_colour_says_nothing_at_the_neutral_distance() -> None:
    """Both halves at d^2 = 1 - sqrt(0.25) = 0.5; equal looks give exp(2 kappa d_0^2)."""
    one, other = np.array([[[1.0, 0.0]] * 2]), np.array([[[0.25, 0.75]] * 2])
    assert ratio(one, other, kappa=7.0, neutral=np.sqrt(0.5)) == pytest.approx(1.0)
    assert ratio(one, one, kappa=2.0, neutral=0.5) == pytest.approx(np.exp(1.0))


@pytest.mark.parametrize(
    ("picture", "boxes", "bins"),
    [
        (np.zeros((4, 4, 2), np.uint8), np.ones((1, 4)), 8),
        (np.zeros((4, 4, 3)), np.ones((1, 4)), 8),
        (np.zeros((4, 4, 3), np.uint8), np.array([[np.nan, 1, 1, 1]]), 8),
        (np.zeros((4, 4, 3), np.uint8), np.ones((1, 3)), 8),
        (np.zeros((4, 4, 3), np.uint8), np.ones((1, 4)), 7),
    ],
)
def test_colour_refuses_what_it_cannot_count(
    picture: NDArray[np.uint8], boxes: NDArray[np.float64], bins: int
) -> None:
    with pytest.raises(ValueError, match="must be"):
        histograms(picture, boxes, bins)


def test_points_in_zones() -> None:
    points = np.array([[15.0, 15.0], [9.0, 15.0], [15.0, 21.0], [41.0, 41.0]])
    assert inside(points, [SQUARE]).tolist() == [True, False, False, False]
    assert inside(points, [SQUARE, ((40.0, 40.0), (45.0, 40.0), (40.0, 45.0))]).tolist() == [
        True,
        False,
        False,
        True,
    ]
    assert not inside(points, []).any()


def test_points_in_a_zone_with_a_notch() -> None:
    notched = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 2.0), (0.0, 10.0))
    assert inside(np.array([[5.0, 1.0], [5.0, 5.0], [1.0, 5.0], [9.0, 5.0]]), [notched]).tolist() == [
        True, False, True, True,
    ]  # fmt: skip


def walked(rule: OneWay, path: list[tuple[float, float]], dt: float = 0.1) -> list[bool]:
    heading, flags = Heading(*path[0]), []
    for x, y in path[1:]:
        heading = follow(heading, x, y, dt, rule)
        flags.append(heading.wrong)
    return flags


def test_wrong_way_needs_distance_and_time() -> None:
    """Direction +x; 5 px a step of 0.1 s backwards: 20 px after the 4th step, 0.5 s after the 5th."""
    path = [(100.0 - 5.0 * k, 0.0) for k in range(8)]
    assert walked(OneWay((2.0, 0.0), 20.0, 0.0), path) == [False] * 3 + [True] * 4
    assert walked(OneWay((2.0, 0.0), 20.0, 0.5), path) == [False] * 4 + [True] * 3
    assert not any(walked(OneWay((-1.0, 0.0), 20.0, 0.0), path))


def test_wrong_way_counts_from_the_farthest_point() -> None:
    """Forty px the right way do not buy a way back of twenty."""
    path = [(10.0 * k, 0.0) for k in range(5)] + [(40.0 - 10.0 * k, 0.0) for k in range(1, 4)]
    assert walked(OneWay((1.0, 0.0), 20.0, 0.1), path) == [False] * 5 + [True] * 2


def test_sideways_is_not_backwards() -> None:
    """A cosine of 0.45 with the opposite direction is no wrong way, 0.55 is one."""
    for cosine, wrong in ((0.45, False), (0.55, True)):
        step = 10.0 * np.array([-cosine, np.sqrt(1.0 - cosine**2)])
        path = [(float(x), float(y)) for x, y in (step * k for k in range(20))]
        assert walked(OneWay((1.0, 0.0), 20.0, 0.1), path)[-1] is wrong


def test_turning_round_clears_the_flag_after_the_same_distance() -> None:
    path = [(-10.0 * k, 0.0) for k in range(4)] + [(-30.0 + 10.0 * k, 0.0) for k in range(1, 5)]
    assert walked(OneWay((1.0, 0.0), 20.0, 0.1), path) == [False, True, True, True, False, False, False]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 9.9))
def test_a_standing_object_is_never_flagged(seed: int, jitter: float) -> None:
    """However long it stands: its way back is at most twice the jitter."""
    rng = np.random.default_rng(seed)
    path = [(float(x), float(y)) for x, y in rng.uniform(-jitter, jitter, (400, 2))]
    assert not any(walked(OneWay((1.0, 0.3), 28.1, 0.0), path))


@pytest.mark.parametrize("bad", [((0.0, 0.0), 20.0, 0.3), ((1.0, 0.0), 0.0, 0.3), ((1.0, 0.0), 20.0, -1.0)])
def test_one_way_refuses(bad: tuple[tuple[float, float], float, float]) -> None:
    with pytest.raises(ValueError, match=r"direction|one way"):
        OneWay(*bad)


def test_region_of_two_targets_is_cut_as_they_lie() -> None:
    """Two boxes of 10 x 20 side by side were predicted at x = 15 and 25; the region lies 2 px further."""
    predicted = np.array([[15.0, 30.0, 10.0, 20.0], [25.0, 30.0, 10.0, 20.0], [80.0, 80.0, 10.0, 20.0]])
    boxes = np.array([[22.0, 31.0, 20.0, 20.0], [80.0, 81.0, 10.0, 20.0]])
    cut = split(boxes, predicted)
    assert cut.tolist() == [[80.0, 81.0, 10.0, 20.0], [17.0, 31.0, 10.0, 20.0], [27.0, 31.0, 10.0, 20.0]]


def test_parts_follow_the_region_as_it_grows() -> None:
    predicted = np.array([[15.0, 30.0, 10.0, 20.0], [25.0, 30.0, 10.0, 20.0]])
    cut = split(np.array([[20.0, 30.0, 24.0, 22.0]]), predicted)
    assert cut.tolist() == [[14.0, 30.0, 12.0, 22.0], [26.0, 30.0, 12.0, 22.0]]


def test_what_is_not_cut() -> None:
    """A region no larger than one target, a region with one target, no region, and targets without one."""
    behind = np.array([[15.0, 30.0, 10.0, 20.0], [17.0, 30.0, 10.0, 20.0]])
    small = np.array([[16.0, 30.0, 12.0, 20.0]])
    assert split(small, behind) is small
    assert split(np.array([[16.0, 30.0, 40.0, 20.0]]), behind[:1]).tolist() == [[16.0, 30.0, 40.0, 20.0]]
    assert len(split(np.zeros((0, 4)), behind)) == 0
    far = np.array([[200.0, 30.0, 40.0, 20.0]])
    assert split(far, behind) is far


def test_centres_at_the_edge_by_hand() -> None:
    """A target of 20 x 10 whose box is cut: 12 px are seen at the right edge, 6 at the upper one."""
    shape = (100, 200)
    boxes = np.array([[194.0, 50.0, 12.0, 10.0], [50.0, 3.0, 20.0, 6.0], [100.0, 50.0, 12.0, 6.0]])
    found = centres(boxes, np.array([[20.0, 10.0]]), shape)
    assert found.tolist() == [[[198.0, 50.0], [50.0, 1.0], [100.0, 50.0]]]


def test_a_box_from_edge_to_edge_stays() -> None:
    assert centres(np.array([[50.0, 5.0, 100.0, 10.0]]), np.array([[300.0, 4.0]]), (10, 100)).tolist() == [
        [[50, 5]]
    ]


@pytest.mark.parametrize(
    "changed",
    [
        {"clutter": 0.0}, {"clutter": -1.0}, {"detection": 0.0}, {"detection": 1.5}, {"noise_px": 0.0},
        {"missed_s": -0.1}, {"confirm_above": 2.0}, {"gate_sigma": float("inf")}, {"lifetime_s": float("nan")},
        {"exact": 20}, {"most": 0}, {"space_weight": 0.0}, {"exits": [((0.0, 0.0), (1.0, 1.0))]},
    ],
)  # fmt: skip
def test_options_out_of_range_are_named(changed: dict[str, object]) -> None:
    name = next(iter(changed))
    with pytest.raises(ValueError, match="zone" if name == "exits" else name):
        JpdaOptions(**changed)  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [{"weight": -0.1}, {"kappa": -1.0}, {"neutral": 1.2}, {"bins": 5}])
def test_colour_options_out_of_range(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="colour"):
        ColourOptions(**bad)  # type: ignore[arg-type]
