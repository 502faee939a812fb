"""The tracker on small generated scenes: births, occlusions, deaths, identities."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion import ConstantPosition, ConstantVelocity, FreeAcceleration
from lumpwatch.models.trackers.imm_pf import (
    ImmOptions,
    ImmPfTracker,
    LinearSize,
    ObservationOptions,
    TrackerOptions,
)
from lumpwatch.models.trackers.tracked import TrackedObject

Image = NDArray[np.uint8]
SHAPE = (120, 240)
SIZE = LinearSize(0.0, 40.0, 0.4)
"""Everybody is 16 x 40 px."""
DT = 1.0 / 7.0
GROUND = np.random.default_rng(0).integers(110, 140, (*SHAPE, 3)).astype(np.uint8)
RED, BLUE, GREEN, BLACK = (30, 30, 200), (200, 40, 30), (40, 180, 40), (10, 10, 10)
Person = tuple[float, float, tuple[int, int, int], tuple[int, int, int]]
"""Centre x and y, colour of the upper and of the lower half."""


class Difference:
    """A foreground that knows the empty scene; satisfies `Foreground`."""

    def apply(self, picture: Image, learn: bool = True) -> Image:
        far = np.abs(picture.astype(int) - GROUND).max(axis=2) > 30
        return (far * 255).astype(np.uint8)


def draw(people: Iterable[Person]) -> Image:
    """The scene with people, later ones in front."""
    picture = GROUND.copy()
    for x, y, upper, lower in people:
        left, right = max(round(x - 8), 0), max(round(x + 8), 0)
        picture[round(y - 20) : round(y), left:right] = upper
        picture[round(y) : round(y + 20), left:right] = lower
    return picture


def tracker(seed: int = 0, options: TrackerOptions | None = None) -> ImmPfTracker:
    models = (ConstantPosition("CP", 6.0), ConstantVelocity("CV", 30.0), FreeAcceleration("CA", 80.0))
    return ImmPfTracker(options or TrackerOptions(), models, SIZE, Difference(), np.random.default_rng(seed))


def play(scene: Sequence[Sequence[Person]], one: ImmPfTracker) -> list[tuple[TrackedObject, ...]]:
    return [tuple(found for found in one.step(draw(people), DT) if found.confirmed) for people in scene]


def walk(frames: int, start: float = 40.0, speed: float = 4.0, y: float = 60.0) -> list[list[Person]]:
    return [[(start + speed * k, y, RED, BLUE)] for k in range(frames)]


def test_one_person_is_followed() -> None:
    found = play(walk(35), tracker())
    assert not found[0]
    assert all(len(some) == 1 for some in found[4:])
    assert len({some[0].id for some in found[4:]}) == 1
    errors = [np.hypot(*(some[0].box[:2] - [40 + 4 * k, 60])) for k, some in enumerate(found) if k > 9]
    assert max(errors) < 10.0
    assert np.median(errors) < 2.0
    last = found[-1][0]
    assert last.velocity == pytest.approx([28.0, 0.0], abs=12.0)
    assert last.box[2:] == pytest.approx([16.0, 40.0])
    assert last.existence > 0.99
    assert last.model_shares.shape == (3,)
    assert last.model_shares.sum() == pytest.approx(1.0)
    assert 0.0 < last.spread.max() < 8.0


def test_an_empty_scene_has_no_targets() -> None:
    assert not any(play([[]] * 10, tracker()))


def test_models_follow_the_motion() -> None:
    """Constant position leads while the person stands, and has the least share while he walks."""
    standing: list[list[Person]] = [[(40.0, 60.0, RED, BLUE)]] * 30
    found = play(standing + walk(30, 44.0, 6.0), tracker())
    while_standing = np.mean([some[0].model_shares for some in found[10:30]], axis=0)
    while_walking = np.mean([some[0].model_shares for some in found[35:60]], axis=0)
    assert while_standing[0] > 2.0 * while_walking[0]
    assert while_walking[1:].sum() > 0.7


def test_birth_waits_for_evidence() -> None:
    """A person in one picture only is never confirmed."""
    assert not any(play([[], walk(1)[0], [], [], [], []], tracker()))


def test_what_is_not_as_large_as_a_person_bears_nobody() -> None:
    picture = GROUND.copy()
    picture[70:80, 50:60] = RED
    one = tracker()
    assert not any(one.step(picture, DT) for _ in range(5))


def test_two_side_by_side_are_two() -> None:
    scene: list[list[Person]] = [
        [(40.0 + 3 * k, 60.0, RED, BLUE), (56.0 + 3 * k, 60.0, GREEN, BLACK)] for k in range(20)
    ]
    found = play(scene, tracker())
    assert all(len(some) == 2 for some in found[5:])
    columns = sorted(float(one.box[0]) for one in found[-1])
    assert columns == pytest.approx([97.0, 113.0], abs=5.0)


def crossing(frames: int = 40) -> list[list[Person]]:
    """Two walk towards each other; the second one, nearer to the camera, hides the first."""
    return [[(40 + 4.0 * k, 56.0, RED, BLUE), (200 - 4.0 * k, 64.0, GREEN, BLACK)] for k in range(frames)]


@pytest.mark.parametrize("seed", range(4))
def test_identities_survive_an_occlusion(seed: int) -> None:
    found = play(crossing(), tracker(seed))
    first, last = ({one.id: float(one.box[0]) for one in found[k]} for k in (8, 39))
    assert set(first) == set(last)
    left, right = sorted(first, key=lambda who: first[who])
    assert last[left] == pytest.approx(196.0, abs=6.0)
    assert last[right] == pytest.approx(44.0, abs=6.0)


def test_a_hidden_target_goes_on() -> None:
    """Behind a nearer person the far one is still reported."""
    found = play(crossing(), tracker())
    middle = found[20]
    assert len(middle) == 2
    assert all(one.existence > 0.9 for one in middle)


def test_a_target_stops_behind_a_sign_that_is_known() -> None:
    """It stands behind a sign for six seconds; where the sign is not known the tracker gives it up."""
    sign = np.zeros(SHAPE, np.uint8)
    sign[30:90, 95:135] = 1
    scene = walk(20) + [[(116.0, 60.0, RED, BLUE)]] * 42
    kept = {}
    for cover in (None, sign):
        one = ImmPfTracker(
            replace(TrackerOptions(), hidden_s=10.0),
            (ConstantPosition("CP", 6.0), ConstantVelocity("CV", 30.0)),
            SIZE,
            Difference(),
            np.random.default_rng(0),
            cover,
        )
        for people in scene:
            picture = draw(people)
            picture[sign != 0] = GROUND[sign != 0]
            found = one.step(picture, DT)
        kept[cover is not None] = [some.box[:2] for some in found if some.confirmed]
    assert kept[False] == []
    assert len(kept[True]) == 1
    assert np.hypot(*(kept[True][0] - [116, 60])) < 20.0


def test_a_target_that_vanishes_ends() -> None:
    options = TrackerOptions(weak_s=1.0)
    found = play(walk(15) + [[]] * 12, tracker(options=options))
    assert len(found[14]) == 1
    # A second is seven pictures; it may take one or two until the last trace is gone.
    assert not any(found[25:])
    existence = [some[0].existence for some in found[14:] if some]
    assert existence[-1] < existence[0]


def test_a_target_that_leaves_ends_at_the_edge() -> None:
    found = play(walk(40, 120.0, 5.0), tracker())
    assert found[15]
    assert not any(found[26:])  # its right edge reaches the picture's at k = 22


def returning(gap: int) -> list[list[Person]]:
    """Walks, is gone, and is back at about the place where he would be."""
    before = walk(15)
    return before + [[]] * gap + walk(15, 110.0)


def test_a_lost_target_is_known_again() -> None:
    options = TrackerOptions(weak_s=0.4)
    found = play(returning(8), tracker(options=options))
    assert not found[22]
    assert found[-1][0].id == found[14][0].id


def test_another_one_at_that_place_is_not_taken_for_it() -> None:
    options = TrackerOptions(weak_s=0.4)
    scene = returning(8)
    other: list[list[Person]] = [[(x, y, BLACK, GREEN) for x, y, _, _ in people] for people in scene[23:]]
    found = play(scene[:23] + other, tracker(options=options))
    assert found[-1][0].id != found[14][0].id


def test_a_forgotten_target_gets_a_new_id() -> None:
    options = TrackerOptions(weak_s=0.4, lost_s=0.5)
    found = play(returning(14), tracker(options=options))
    assert found[-1][0].id != found[14][0].id


def test_ids_are_never_given_twice_in_a_picture() -> None:
    for some in play(crossing() + returning(8), tracker(options=TrackerOptions(weak_s=0.4))):
        assert len({one.id for one in some}) == len(some)


def test_same_seed_same_result() -> None:
    first, second, third = (play(crossing(15), tracker(seed)) for seed in (1, 1, 2))
    boxes = [[one.box.tolist() for some in found for one in some] for found in (first, second, third)]
    assert boxes[0] == boxes[1]
    assert boxes[0] != boxes[2]


def test_state_does_not_grow_with_the_pictures() -> None:
    """People come and go; what the tracker holds is bounded by those in view and those lost of late."""
    one = tracker(options=TrackerOptions(weak_s=0.3, lost_s=1.0))
    play(walk(12), one)
    with_a_target = len(pickle.dumps(one))
    for _ in range(6):
        play([[]] * 12, one)
        assert one.step(draw([]), DT) == ()
        assert len(pickle.dumps(one)) <= with_a_target  # one that was lost of late at the most
        play(walk(12), one)


@dataclass
class Mask:
    """A foreground that is told what to say."""

    mask: Image

    def apply(self, picture: Image, learn: bool = True) -> Image:
        return self.mask


def test_twins_become_one() -> None:
    """Somebody who looks alike is gone behind the other, who is not shared out between them: the older one stays."""
    unshared = ObservationOptions(claim=0.0)
    one = tracker(options=TrackerOptions(observation=unshared, weak_s=100.0, hidden_s=100.0))
    stands: Person = (80.0, 60.0, RED, BLUE)
    (old,) = play([[stands]] * 8, one)[-1]
    found = play([[stands, (140.0 - 4.0 * k, 60.0, RED, BLUE)] for k in range(16)], one)
    assert len(found[-1]) == 2
    found = play([[stands]] * 16, one)
    assert [some.id for some in found[-1]] == [old.id]


@pytest.mark.parametrize("dt", [0.0, -0.1, float("nan"), float("inf")])
def test_a_step_needs_time(dt: float) -> None:
    with pytest.raises(ValueError, match="dt"):
        tracker().step(draw([]), dt)


def test_a_picture_of_another_size() -> None:
    one = ImmPfTracker(
        TrackerOptions(),
        (ConstantPosition("CP", 6.0),),
        SIZE,
        Mask(np.zeros(SHAPE, np.uint8)),
        np.random.default_rng(0),
    )
    one.step(draw([]), DT)
    with pytest.raises(ValueError, match=r"picture must be .* \(120, 240, 3\), not \(50, 240, 3\)"):
        one.step(draw([])[:50], DT)


def test_options_that_cannot_be_meant() -> None:
    with pytest.raises(ValueError, match="usual_s"):
        TrackerOptions(usual_s=0.0)
    with pytest.raises(ValueError, match="log odds"):
        TrackerOptions(confirm_log_odds=-2.0)
    with pytest.raises(ValueError, match="particles"):
        tracker(options=TrackerOptions(filter=ImmOptions(particles=2)))
