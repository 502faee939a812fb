"""What stands while the belt around it moves, told from pictures: the belt is a texture that is rolled on."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.picture.standing import StandingMeter, middle
from lumpwatch.models.roi import Image

HEIGHT, WIDTH, SPEED_PX_S, FPS = 160, 128, 40.0, 12.5
BOX = np.array([[64.0, 80.0, 36.0, 32.0]])


def belt(contrast: float = 40.0) -> NDArray[np.float32]:
    noise = np.random.default_rng(5).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.asarray(110.0 + contrast * smooth / smooth.std(), np.float32)


def blot(picture: NDArray[np.float32], x: float, y: float, level: float = 30.0) -> NDArray[np.float32]:
    there = np.zeros_like(picture)
    cv2.ellipse(there, (round(x), round(y)), (16, 14), 0, 0, 360, 1.0, -1)
    soft = cv2.GaussianBlur(there, (0, 0), 2.0)
    return picture * (1 - soft) + level * soft


def looked(
    pictures: list[NDArray[np.float32]], box: NDArray[np.float64] = BOX
) -> tuple[bool | None, NDArray[np.float64] | None]:
    meter = StandingMeter(np.ones((HEIGHT, WIDTH), np.uint8))
    for k, picture in enumerate(pictures):
        meter.add(k / FPS, np.clip(picture, 0, 255).astype(np.uint8))
    (look,) = meter.look(box)
    return (None, None) if look is None else (look.same, look.moved)


def rolled(seconds: float = 2.5, contrast: float = 40.0) -> list[NDArray[np.float32]]:
    texture = belt(contrast)
    return [np.roll(texture, round(k * SPEED_PX_S / FPS), axis=0) for k in range(round(seconds * FPS))]


@pytest.mark.parametrize("trembles_px", [0.0, 2.0])
def test_an_insect_on_the_lens_stands(trembles_px: float) -> None:
    pictures = [blot(p, 64 + trembles_px * np.sin(2 * k), 80) for k, p in enumerate(rolled())]
    same, moved = looked(pictures)
    assert same is True
    assert moved is not None
    assert moved[1] >= 0.75 * 32 - 1  # the belt has left the place
    assert abs(moved[0]) < 2


def test_burnt_in_letters_stand() -> None:
    letters: list[NDArray[np.float32]] = []
    for k, picture in enumerate(rolled()):
        gray = np.clip(picture, 0, 255).astype(np.uint8)
        cv2.putText(gray, f"09:1{k // 12}", (40, 88), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 3)
        letters.append(gray.astype(np.float32))
    assert looked(letters)[0] is True


def test_a_lump_rides() -> None:
    frames = rolled()
    step = SPEED_PX_S / FPS
    pictures = [blot(p, 64, 80 - (len(frames) - 1 - k) * step) for k, p in enumerate(frames)]
    assert looked(pictures)[0] is False


def test_ore_is_no_stranger() -> None:
    assert looked(rolled())[0] is False


def test_nothing_is_said_of_what_lies_on_a_belt_at_rest() -> None:
    assert looked([blot(belt(), 64, 80)] * 40) == (None, None)


def test_nothing_is_said_where_the_belt_shows_nothing_to_follow() -> None:
    rng = np.random.default_rng(1)
    bare = [
        np.full((HEIGHT, WIDTH), 100.0, np.float32) + rng.normal(0, 2, (HEIGHT, WIDTH)) for _ in range(30)
    ]
    assert looked([blot(p.astype(np.float32), 64, 80) for p in bare])[0] is None


def test_a_belt_that_stops_under_a_lump_makes_it_no_stranger() -> None:
    """The lump has ridden up to its place with the belt, then both stand for a second."""
    ride = rolled(2.0)
    step = SPEED_PX_S / FPS
    pictures = [blot(p, 64, 80 - (len(ride) - 1 - k) * step) for k, p in enumerate(ride)]
    assert looked([*pictures, *[pictures[-1]] * 12])[0] is False


def test_a_gap_begins_anew() -> None:
    meter = StandingMeter(np.ones((HEIGHT, WIDTH), np.uint8))
    for k, picture in enumerate(rolled()):
        meter.add(
            k / FPS + (5.0 if k == 30 else 0.0), np.clip(blot(picture, 64, 80), 0, 255).astype(np.uint8)
        )
    assert meter.look(BOX) == (None,)


def test_boxes_beyond_the_picture_do_no_harm() -> None:
    picture: list[Image] = [np.clip(p, 0, 255).astype(np.uint8) for p in rolled()]
    meter = StandingMeter(np.ones((HEIGHT, WIDTH), np.uint8))
    for k, one in enumerate(picture):
        meter.add(k / FPS, one)
    boxes = np.array([[-50.0, -50, 20, 20], [127, 159, 90, 90], [64, 80, 0.5, 0.5], [64, 80, 900, 900]])
    assert len(meter.look(boxes)) == 4
    assert meter.look(np.zeros((0, 4))) == ()


@pytest.mark.parametrize("n", [1, 2, 7, 8, 301])
def test_the_middle_is_the_median_to_the_bit(n: int) -> None:
    values = np.random.default_rng(n).normal(size=(n, 2)).astype(np.float32)
    assert middle(values).tobytes() == np.median(values, axis=0).astype(np.float32).tobytes()
