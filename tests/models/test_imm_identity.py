"""Two targets that met are told apart by what they looked like before."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import ConstantVelocity
from lumpwatch.models.state import SIZE, H, W, X, Y
from lumpwatch.models.trackers.imm_pf import (
    ImmPfTracker,
    LinearSize,
    ObservationOptions,
    PictureGrids,
    Reference,
    TrackerOptions,
)
from lumpwatch.models.trackers.imm_pf.identity import Looks, exchanged, touching
from lumpwatch.models.trackers.imm_pf.kernel import COLOURS, MOTIONS

DT = 0.1


def look(*bins: int) -> Reference:
    """Equal shares of some colours, in both halves."""
    colours = np.zeros(COLOURS)
    colours[list(bins)] = 1.0 / len(bins)
    return Reference(colours, colours, np.full(MOTIONS, 1.0 / MOTIONS))


def met(before: Reference, since: Reference) -> Looks:
    """One that met identity 9 and stands clear again."""
    looks = Looks()
    looks.see(before, DT, 5.0)
    looks.touch(9)
    looks.see(since, DT, 5.0)
    return looks


RED, BLUE, MIXED = look(1), look(2), look(1, 2)


@pytest.mark.parametrize(
    ("a", "b", "says"),
    [((RED, BLUE), (BLUE, RED), True), ((RED, RED), (BLUE, BLUE), False), ((RED, RED), (RED, RED), False),
     ((RED, MIXED), (MIXED, RED), True)],
)  # fmt: skip
def test_looks_decide(a: tuple[Reference, Reference], b: tuple[Reference, Reference], says: bool) -> None:
    assert exchanged(met(*a), met(*b), 0.15) is says


def test_nothing_is_decided_where_one_was_not_seen_clearly() -> None:
    newcomer, unseen = Looks(since=RED), Looks(before=RED)
    assert not exchanged(newcomer, met(RED, BLUE), 0.0)
    assert not exchanged(unseen, met(RED, BLUE), 0.0)


def test_what_was_seen_between_two_meetings_belongs_to_nobody() -> None:
    looks = met(RED, BLUE)
    looks.touch(8)
    assert looks.since is None
    assert looks.since_s == 0.0


def test_one_who_has_met_nobody_left_is_himself_again() -> None:
    looks = met(RED, BLUE)
    looks.settle({1, 2})
    assert not looks.met
    assert looks.before is not None
    assert looks.before.upper == pytest.approx(MIXED.upper)


def test_a_look_fades_with_time() -> None:
    looks = Looks()
    looks.see(RED, DT, 1.0)
    for _ in range(30):
        looks.see(BLUE, DT, 1.0)
    assert looks.before is not None
    assert looks.before.upper[1] == pytest.approx(np.exp(-3.0))


def box(x: float, y: float = 50.0) -> NDArray[np.float64]:
    state = np.zeros(SIZE)
    state[[X, Y, W, H]] = x, y, 10.0, 20.0
    return state


def test_boxes_touch_from_a_share_of_the_smaller_one_on() -> None:
    assert list(touching([box(10.0), box(18.5), box(90.0)], 0.1)) == [(0, 1)]
    assert list(touching([box(10.0), box(19.5)], 0.1)) == []


class Nothing:
    """A background model that is never asked."""

    def apply(self, picture: NDArray[np.uint8], learn: bool = True) -> NDArray[np.uint8]:
        raise AssertionError


def grids(*people: tuple[float, int]) -> PictureGrids:
    """People of 20 x 60 px with their feet in one row, by place and colour; later ones stand before earlier ones."""
    colour, foreground = np.zeros((100, 200), np.uint8), np.zeros((100, 200), np.uint8)
    for x, bin_ in people:
        columns = slice(int(x / 2) - 5, int(x / 2) + 5)
        colour[40:70, columns], foreground[40:70, columns] = bin_, 1
    return PictureGrids(colour, np.zeros((100, 200), np.uint8), foreground, (200, 400))


def mistaken(settled_s: float) -> int:
    """Runs of four in which two who meet and turn round end with each other's identity."""
    # The filter is blind to colour, so motion alone leads it through the meeting: it says that they passed.
    blind = TrackerOptions(settled_s=settled_s, observation=ObservationOptions(colour=0.0))
    wrong = 0
    for seed in range(4):
        walk, size = ConstantVelocity("walk", 8.0), LinearSize(0.0, 60.0, 1.0 / 3.0)
        tracker = ImmPfTracker(blind, (walk,), size, Nothing(), np.random.default_rng(seed))
        seen: list[dict[int, bool]] = []
        for k in range(65):
            away = 4.0 * abs(k - 30)
            objects = tracker.advance(grids((200.0 - away / 2, 3), (200.0 + away / 2, 4)), DT)
            seen.append({one.id: bool(one.box[0] > 200.0) for one in objects if one.confirmed})
        assert len(seen[15]) == 2
        wrong += seen[15] != seen[-1]
    return wrong


def test_people_who_turn_round_behind_each_other_keep_their_identities() -> None:
    assert mistaken(settled_s=0.0) >= 2
    assert mistaken(settled_s=1.0) == 0
