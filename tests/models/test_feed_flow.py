"""Displacements of tiles and the share that is covered, on textures of known shift."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lumpwatch.models.feed import CoverMeter, FeedMotion, Moves, TileFlow

SHAPE = (96, 128)
MASK = np.ones(SHAPE, np.uint8)
BARE = 0.03


def texture(seed: int = 0, side: int = 260) -> np.ndarray:
    rng = np.random.default_rng(seed)
    field = cv2.GaussianBlur(rng.standard_normal((side, side)).astype(np.float32), (0, 0), 1.0)
    return 100.0 + 25.0 * field / field.std()


def seen(ore: np.ndarray, x: float, y: float, seed: int = 0, noise: float = 2.0) -> np.ndarray:
    matrix = np.array([[1, 0, 40 - x], [0, 1, 40 - y]], float)
    part = cv2.warpAffine(
        ore.astype(np.float32), matrix, SHAPE[::-1], flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    )
    noisy = part + noise * np.random.default_rng(seed).standard_normal(SHAPE)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def motion() -> FeedMotion:
    flow = TileFlow(MASK)
    return FeedMotion(flow, CoverMeter(flow.reduced(MASK)))


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.0, 0.7), (0.0, 5.3), (-3.4, 6.0), (0.0, -8.0)])
def test_a_known_shift_is_found_to_a_fifth_of_a_pixel(x: float, y: float) -> None:
    flow, ore = TileFlow(MASK), texture()
    found = flow.between(flow.spectra(seen(ore, 0, 0, 1)), flow.spectra(seen(ore, x, y, 2)))
    assert np.abs(np.median(found.shift, axis=0) - (x, y)).max() < 0.2
    assert np.median(found.peak) > 0.4


def test_unrelated_textures_give_no_peak() -> None:
    flow = TileFlow(MASK)
    found = flow.between(flow.spectra(seen(texture(1), 0, 0)), flow.spectra(seen(texture(2), 0, 0, 3)))
    assert np.median(found.peak) < 0.27


def test_a_belt_behind_a_grid_that_stands_still_is_seen_to_move() -> None:
    moves, ore = motion(), texture()
    grid = np.zeros(SHAPE, np.float32)
    grid[::6] = 18.0
    grid[:, ::7] += 18.0
    for k in range(6):
        moves.add(np.clip(seen(ore, 0, 5.0 * k, k) + grid, 0, 255).astype(np.uint8), 0.1 * k)
    found = moves.compare(BARE)
    assert found.moves is Moves.MOVING
    assert found.velocity is not None
    assert found.velocity[1] == pytest.approx(50.0, abs=3.0)


def test_what_stands_stands_under_noise_that_hides_each_tile() -> None:
    moves, ore = motion(), texture()
    for k in range(6):
        moves.add(seen(ore, 0, 0, k, noise=30.0), 0.1 * k)
    assert moves.compare(0.0).moves is Moves.STANDING


@pytest.mark.parametrize(("step", "moves"), [(0.0, Moves.UNTOLD), (5.0, Moves.MOVING)])
def test_faint_texture_that_stands_may_be_the_pictures_own_and_tells_nothing(
    step: float, moves: Moves
) -> None:
    feed, ore = motion(), 100.0 + 0.06 * (texture() - 100.0)
    for k in range(6):
        feed.add(seen(ore, 0, step * k, k, noise=0.3), 0.1 * k)
    found = feed.compare(0.001)
    assert found.moves is moves
    assert found.plain == (moves is Moves.UNTOLD)  # what moves is told to be faint


@pytest.mark.parametrize("speed", [4.0, 40.0, 110.0])
def test_slow_and_fast_belts_are_measured_after_the_first_pictures(speed: float) -> None:
    moves, ore, told = motion(), texture(side=400), []
    for k in range(30):
        moves.add(seen(ore, 0, (speed * k / 15.0) % 200.0, k), k / 15.0)
        if k % 3 == 2 and (found := moves.compare(BARE)).velocity is not None:
            told.append(found.velocity[1])
    assert np.median(told[1:]) == pytest.approx(speed, rel=0.05)


def test_a_picture_sent_again_tells_nothing_and_a_new_one_that_is_alike_tells_that_it_stands() -> None:
    moves, ore = motion(), texture()
    for k in range(4):
        moves.add(seen(ore, 0, 3.0 * k, k), 0.05 * k)
    assert moves.compare(BARE).moves is Moves.MOVING
    last = seen(ore, 0, 9.0, 3)
    for k in range(20):
        moves.add(last, 0.2 + 0.1 * k)
        assert moves.compare(BARE).moves is Moves.UNTOLD
    moves.add(seen(ore, 0, 9.0, 99), 2.3)  # the next key frame
    assert moves.compare(BARE).moves is Moves.STANDING


def test_the_covered_share_is_that_of_the_area_and_noise_is_no_cover() -> None:
    cover, ore = CoverMeter(MASK), texture()
    full = seen(ore, 0, 0)
    bare = np.clip(60 + 5 * np.random.default_rng(1).standard_normal(SHAPE), 0, 255).astype(np.uint8)
    half = np.where(np.arange(SHAPE[0])[:, None] < 48, bare, full)
    assert cover.covered(full, BARE) > 0.95
    assert cover.covered(bare, BARE) < 0.05
    assert cover.covered(half, BARE) == pytest.approx(0.5, abs=0.1)  # a cell at the edge shows it


def test_ground_that_is_seen_small_counts_for_what_it_is() -> None:
    weight = np.ones(SHAPE, np.float32)
    weight[:48] = 3.0
    ore = texture()
    half = np.where(np.arange(SHAPE[0])[:, None] < 48, np.uint8(60), seen(ore, 0, 0))
    assert CoverMeter(MASK, weight).covered(half, BARE) == pytest.approx(0.25, abs=0.13)


def test_a_region_that_is_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="too small to see its feed move"):
        TileFlow(np.ones((20, 100), np.uint8))
