"""What the net is taught: the truth of a picture, and which bodies a picture shows at all."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.service.training.model_builder.faint import without_faint
from lumpwatch.service.training.model_builder.scene import Belt, mix, mottle
from lumpwatch.service.training.model_builder.stock import SOFT
from lumpwatch.service.training.model_builder.truth import truth_of

HEIGHT, WIDTH = 120, 160


def ids(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """A map of rectangular bodies, numbered from 1."""
    out = np.zeros((HEIGHT, WIDTH), np.int32)
    for number, (x0, y0, x1, y1) in enumerate(boxes, start=1):
        out[y0:y1, x0:x1] = number
    return out


def ore(seed: int = 0, spread: float = 8.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(110.0, spread, (HEIGHT, WIDTH))


def test_a_body_has_its_outline_and_the_distances_to_its_sides() -> None:
    truth = truth_of(ids((40, 20, 80, 60)))
    np.testing.assert_array_equal(truth.boxes, [[40, 20, 80, 60]])
    y, x = 9, 14  # its cell's middle: 38, 58
    assert truth.body[y, x] == 1
    np.testing.assert_allclose(truth.sides[:, y, x], [58 - 40, 38 - 20, 80 - 58, 60 - 38])
    assert truth.body[2, 2] == 0
    assert truth.edge[9, 9:11].any()
    assert not truth.edge[9, 13:16].any()


def test_what_is_smaller_than_a_body_and_larger_than_ore_is_not_known() -> None:
    truth = truth_of(ids((40, 20, 52, 32), (100, 20, 106, 26)))
    assert len(truth.boxes) == 0
    assert truth.body[6, 11] == -1
    assert truth.body[5, 25] == 0


@pytest.mark.parametrize("shown", ["brighter", "smoother", "outlined"])
def test_a_body_that_the_picture_shows_is_kept(shown: str) -> None:
    bodies = ids((40, 20, 90, 70))
    picture = ore()
    if shown == "brighter":
        picture[20:70, 40:90] += 12.0
    elif shown == "smoother":
        picture[20:70, 40:90] = 110.0 + 0.3 * (picture[20:70, 40:90] - 110.0)
    else:
        picture[20:70, 40:90][[0, 1, -2, -1]] -= 40.0
        picture[20:70, 40:90][:, [0, 1, -2, -1]] -= 40.0
    grey = np.clip(picture, 0, 255).astype(np.uint8)
    np.testing.assert_array_equal(without_faint(grey, bodies), bodies)


@pytest.mark.parametrize("seed", range(5))
def test_a_body_that_nobody_can_see_is_not_known(seed: int) -> None:
    bodies = ids((40, 20, 90, 70))
    grey = np.clip(ore(seed), 0, 255).astype(np.uint8)
    assert (without_faint(grey, bodies)[bodies == 1] == SOFT).all()


def test_one_faint_body_leaves_the_others() -> None:
    bodies = ids((10, 20, 60, 70), (90, 20, 140, 70))
    picture = ore()
    picture[20:70, 90:140] += 40.0
    found = without_faint(np.clip(picture, 0, 255).astype(np.uint8), bodies)
    assert set(np.unique(found)) == {SOFT, 0, 2}


def test_patches_of_another_brightness_are_no_bodies() -> None:
    rng = np.random.default_rng(3)
    belt = Belt(np.full((860, 620), 100.0, np.float32), np.zeros((860, 620), np.int32), 100.0)
    mottle(belt, rng)
    assert belt.grey.std() > 1.0
    assert belt.ids.max() == 0


def test_where_two_ores_meet_nothing_is_known_of_bodies() -> None:
    rng = np.random.default_rng(3)
    here, there = (
        Belt(np.full((860, 620), tone, np.float32), np.zeros((860, 620), np.int32), 100.0)
        for tone in (80.0, 160.0)
    )
    here.ids[100:400, 100:400] = 1
    there.ids[500:600, 100:200] = 1
    mix(here, there, rng)
    assert here.grey.min() < 90.0
    assert here.grey.max() > 150.0
    assert (here.ids[500:600, 100:200] == SOFT).all()
    foreign = here.grey > 95.0
    assert not (here.ids[foreign] > 0).any()
