"""The mixture background and the regions of its masks."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.trackers.foreground import MixtureForeground, MixtureOptions, blobs, cleaned, regions

SHAPE = (60, 90)


def ground(rng: np.random.Generator) -> NDArray[np.uint8]:
    picture = np.full((*SHAPE, 3), 120.0) + rng.normal(0.0, 2.0, (*SHAPE, 3))
    return np.clip(picture, 0, 255).astype(np.uint8)


def test_what_comes_in_is_foreground_and_the_ground_is_not() -> None:
    rng = np.random.default_rng(0)
    foreground = MixtureForeground()
    for _ in range(30):
        mask = foreground.apply(ground(rng))
    assert mask.mean() < 0.01 * 255
    picture = ground(rng)
    picture[20:40, 30:45] = (20, 30, 200)
    mask = foreground.apply(picture)
    assert mask.shape == SHAPE
    assert set(np.unique(mask)) <= {0, 255}
    assert mask[22:38, 32:43].mean() > 0.95 * 255
    assert mask[:15].mean() < 0.01 * 255


def test_a_shadow_is_background() -> None:
    """Two thirds of the brightness and the same colour."""
    rng = np.random.default_rng(1)
    foreground = MixtureForeground(MixtureOptions(blur=0.0))
    for _ in range(30):
        foreground.apply(ground(rng))
    picture = ground(rng)
    picture[20:40, 30:45] = (picture[20:40, 30:45] * 0.66).astype(np.uint8)
    assert foreground.apply(picture)[22:38, 32:43].mean() < 0.05 * 255


def test_whoever_stands_long_becomes_background() -> None:
    """A share of 1 - 0.9 of the memory: 10 of 100 pictures, and not yet after 5."""
    rng = np.random.default_rng(2)
    foreground = MixtureForeground(MixtureOptions(memory=100))
    for _ in range(40):
        foreground.apply(ground(rng))
    shares = []
    for _ in range(25):
        picture = ground(rng)
        picture[20:40, 30:45] = (20, 30, 200)
        shares.append(foreground.apply(picture)[24:36, 34:41].mean() / 255)
    assert shares[4] > 0.95
    assert shares[-1] < 0.05


def test_pictures_that_do_not_fit() -> None:
    foreground = MixtureForeground()
    for wrong in (np.zeros(SHAPE, np.uint8), np.zeros((*SHAPE, 4), np.uint8)):
        with pytest.raises(ValueError, match="shape"):
            foreground.apply(wrong)
    foreground.apply(np.zeros((*SHAPE, 3), np.uint8))
    with pytest.raises(ValueError, match="expected"):
        foreground.apply(np.zeros((10, 10, 3), np.uint8))


@pytest.mark.parametrize("wrong", [{"memory": 0}, {"threshold": 0.0}, {"warm_up": -1}, {"blur": -1.0}])
def test_options_that_cannot_be_meant(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="background model"):
        MixtureOptions(**wrong)  # type: ignore[arg-type]


def test_regions_by_hand() -> None:
    mask = np.zeros(SHAPE, np.uint8)
    mask[10:30, 20:26] = 255
    mask[40:50, 60:80] = 255
    mask[55, 5] = 255
    assert regions(mask, 2).tolist() == [[23.0, 20.0, 6.0, 20.0], [70.0, 45.0, 20.0, 10.0]]
    assert regions(mask, 150).tolist() == [[70.0, 45.0, 20.0, 10.0]]
    assert regions(mask, 1000).shape == (0, 4)
    with pytest.raises(ValueError, match="two axes"):
        regions(np.zeros((*SHAPE, 3), np.uint8), 1)


def test_cleaning_drops_specks_and_joins_a_body_cut_in_two() -> None:
    mask = np.zeros(SHAPE, np.uint8)
    mask[10:30, 20:26] = 255
    mask[18:21] = 0  # a gap of three rows across the body
    mask[50:52, 60:62] = 255  # smaller than the opening
    assert len(regions(mask, 1)) == 3
    assert blobs(mask, 1).tolist() == [[23.0, 20.0, 6.0, 20.0]]
    assert np.array_equal(cleaned(mask, 1, (1, 1)), mask)
    assert cv2.countNonZero(cleaned(mask)) == 120
