"""What stands in a mouth: made textures that move, stand, are passed, veiled and shaken."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest

from lumpwatch.models.mouth import Arrival, Limits, MouthState, MouthWatch
from lumpwatch.models.roi import Image

HEIGHT, WIDTH, STEP_S = 64, 128, 0.2
SPEED = 12.0
"""px/s of what is swallowed."""


def texture(rng: np.random.Generator, height: int = 512) -> Image:
    """Stones of a few pixels (height, WIDTH)."""
    noise = cv2.GaussianBlur(rng.normal(0, 1, (height, WIDTH)), (0, 0), 2.0)
    return np.asarray(np.clip(90 + 30 * noise / noise.std(), 0, 255), np.uint8)


ORE, WALL = texture(np.random.default_rng(2)), texture(np.random.default_rng(3), HEIGHT)


class Mouth:
    """Draws a mouth: material moves down by `speed` px/s; what else there is, is put over it."""

    def __init__(self) -> None:
        self.watch = MouthWatch(np.ones((HEIGHT, WIDTH), np.uint8), Limits(learn_s=4.0))
        self.rng = np.random.default_rng(4)
        self.time_s, self.moved = 0.0, 0.0
        self.picture = WALL

    def look(
        self,
        seconds: float,
        speed: float = SPEED,
        *,
        runs: bool = True,
        fit: bool = True,
        over: Callable[[Image], Image] = lambda picture: picture,
        arrivals: tuple[Arrival, ...] = (),
    ) -> Iterator[MouthState]:
        for _ in range(round(seconds / STEP_S)):
            self.moved += speed * STEP_S
            rows = (np.arange(HEIGHT) - round(self.moved)) % len(ORE)
            drawn = over(ORE[rows].copy())
            noisy = drawn + self.rng.normal(0, 1.5, drawn.shape)
            picture = self.picture = np.asarray(np.clip(noisy, 0, 255), np.uint8)
            yield self.watch.step(picture, self.time_s, runs=runs, fit=fit, arrivals=arrivals)
            self.time_s += STEP_S

    def after(self, seconds: float, speed: float = SPEED, **how: object) -> MouthState:
        return list(self.look(seconds, speed, **how))[-1]  # type: ignore[arg-type]


def test_a_mouth_that_swallows_is_known_and_free() -> None:
    mouth = Mouth()
    states = list(mouth.look(30.0))
    assert not states[int(3.0 / STEP_S)].known
    assert states[-1].known
    assert max(state.share for state in states) < 0.05
    assert not any(state.stuck for state in states)


def test_what_stands_is_seen_within_two_seconds_and_its_time_counts() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    states = list(mouth.look(10.0, 0.0))
    first = next(k for k, state in enumerate(states) if state.standing) * STEP_S
    assert first <= 2.0
    assert states[-1].share > 0.9
    assert 8.0 <= states[-1].stood_s <= 10.0 + 2 * STEP_S
    again = list(mouth.look(4.0))
    assert not again[-1].stuck
    assert again[-1].stood_s == 0.0


def test_slow_material_moves_all_the_same() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    assert max(state.stood_s for state in mouth.look(20.0, 3.0)) < 3.0


def test_time_does_not_count_while_the_feed_stands_and_goes_on_after() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    before = mouth.after(5.0, 0.0)
    stopped = mouth.after(20.0, 0.0, runs=False)
    assert stopped.stood_s == before.stood_s
    assert stopped.standing
    assert mouth.after(2.0, 0.0).stood_s == pytest.approx(before.stood_s + 2.0)


def test_a_feed_that_stands_from_the_beginning_teaches_nothing() -> None:
    mouth = Mouth()
    assert not mouth.after(30.0, 0.0, runs=False).known
    state = mouth.after(9.0, 0.0)
    assert not state.known  # nothing was seen to go through
    assert state.stood_s > 8.0  # and what stands is material, as long as nobody knows better


def test_walls_are_the_mouth_itself() -> None:
    mouth = Mouth()

    def walled(picture: Image) -> Image:
        picture[:, :60] = WALL[:, :60]
        return picture

    states = list(mouth.look(20.0, over=walled))
    assert states[-1].known
    assert states[-1].share < 0.05
    assert max(state.stood_s for state in states) < 6.0  # not for as long as the alarm takes
    assert mouth.after(6.0, 0.0, over=walled).standing


def test_neither_a_veil_nor_stones_that_pass_end_what_stands() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    mouth.after(4.0, 0.0)
    count = iter(range(1000))

    def passed(picture: Image) -> Image:
        k = next(count)
        picture = np.asarray(cv2.addWeighted(picture, 0.6, np.full_like(picture, 200), 0.4, 0), np.uint8)
        if k % 5 == 0:
            y = 4 * k % (HEIGHT - 20)
            picture[y : y + 20] = WALL[y : y + 20]
        return picture

    states = list(mouth.look(6.0, 0.0, over=passed))
    assert all(state.standing for state in states)
    assert states[-1].stood_s > 8.0


def test_a_picture_that_comes_twice_does_not_make_a_grainy_camera_seem_clean() -> None:
    mouth, rng = Mouth(), np.random.default_rng(6)

    def grainy(picture: Image) -> Image:
        grain = cv2.GaussianBlur(rng.normal(0, 1, picture.shape), (0, 0), 1.2)
        dim = 40 + 0.4 * (picture - 90.0)
        return np.asarray(np.clip(dim + 12 * grain / grain.std(), 0, 255), np.uint8)

    mouth.after(14.0, over=grainy)
    before = mouth.after(6.0, 0.0, over=grainy)
    assert before.standing
    again = np.clip(mouth.picture + rng.normal(0, 0.6, mouth.picture.shape), 0, 255)  # as a codec sends it
    mouth.watch.step(np.asarray(again, np.uint8), mouth.time_s, runs=True)
    mouth.time_s += STEP_S
    assert min(state.share for state in mouth.look(6.0, 0.0, over=grainy)) > 0.9 * before.share


def test_a_camera_that_shakes_sees_what_stands() -> None:
    mouth, rng = Mouth(), np.random.default_rng(5)

    def shaken(picture: Image) -> Image:
        x, y = rng.uniform(-1.2, 1.2, 2)
        matrix = np.array([[1, 0, x], [0, 1, y]])
        return np.asarray(
            cv2.warpAffine(picture, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT), np.uint8
        )

    assert not mouth.after(15.0, over=shaken).stuck
    states = list(mouth.look(10.0, 0.0, over=shaken))
    assert states[-1].standing
    assert states[-1].stood_s > 6.5


def test_pictures_that_are_not_fit_change_nothing() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    before = mouth.after(5.0, 0.0)
    assert mouth.after(10.0, fit=False) == before


def lump_over(picture: Image) -> Image:
    picture[16:48, 40:80] = WALL[16:48, 40:80]
    return picture


def test_a_lump_that_came_and_stands_is_a_reason_of_its_own() -> None:
    share = 32 * 40 / (HEIGHT * WIDTH)
    mouth = Mouth()
    mouth.after(10.0)
    mouth.after(1.0, arrivals=(Arrival(7, share),))
    state = mouth.after(9.0, over=lump_over)
    assert state.lump
    assert not state.standing  # too small a share
    assert state.stood_s > 6.0
    assert not mouth.after(3.0).lump


def test_what_stands_without_a_lump_that_came_is_none() -> None:
    mouth = Mouth()
    mouth.after(10.0)
    state = mouth.after(9.0, over=lump_over)
    assert not state.stuck
    mouth = Mouth()
    mouth.after(10.0)
    mouth.after(1.0, arrivals=(Arrival(7, 0.15),))
    mouth.after(10.0)  # it has gone through
    assert not mouth.after(9.0, over=lump_over).stuck


def test_going_on_from_a_snapshot_is_the_same() -> None:
    one, other = Mouth(), Mouth()
    one.after(10.0)
    one.after(2.0, 0.0, arrivals=(Arrival(1, 0.1),))
    other.watch.restore(*one.watch.snapshot())
    other.time_s, other.moved, other.rng = one.time_s, one.moved, np.random.default_rng(9)
    one.rng = np.random.default_rng(9)
    assert list(one.look(6.0, 0.0)) == list(other.look(6.0, 0.0))
    small = MouthWatch(np.ones((32, 32), np.uint8), Limits())
    with pytest.raises(ValueError, match="of another mouth"):
        small.restore(*one.watch.snapshot())


def test_a_mouth_that_is_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 12 working pixels"):
        MouthWatch(np.ones((11, 200), np.uint8), Limits())
