"""Shadows, and learning row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground

Picture = NDArray[np.uint8]
OPTIONS = BackgroundOptions(initial_frames=10)
GREEN, RED = (60.0, 130.0, 90.0), (40.0, 50.0, 150.0)


def place(rng: np.random.Generator, colour: tuple[float, float, float] = GREEN) -> NDArray[np.float64]:
    """Ground (60, 80, 3) of one hue, lighter and darker by a tenth."""
    return np.array(colour) * rng.uniform(0.9, 1.1, (60, 80, 1))


def shown(picture: NDArray[np.float64], rng: np.random.Generator) -> Picture:
    return np.clip(np.round(picture + rng.normal(0.0, 2.0, picture.shape)), 0, 255).astype(np.uint8)


def masks(options: BackgroundOptions, colour: tuple[float, float, float] = GREEN) -> tuple[float, float]:
    """Shares of a shadow and of the red object that casts it which are foreground."""
    rng = np.random.default_rng(0)
    ground = place(rng, colour)
    model = StatisticalBackground(options)
    for _ in range(20):
        model.apply(shown(ground, rng))
    now = ground.copy()
    now[20:40, 30:50] *= 0.6
    now[20:40, 15:30] = RED
    mask = model.apply(shown(now, rng)) == 255
    assert not mask[:18].any()
    return float(mask[20:40, 31:50].mean()), float(mask[20:40, 15:29].mean())


def test_a_shadow_is_background_and_what_casts_it_is_not() -> None:
    shadow, thing = masks(OPTIONS)
    assert shadow < 0.01
    assert thing > 0.99


def test_a_shadow_is_foreground_where_that_is_asked() -> None:
    assert masks(replace(OPTIONS, darkest_shadow=1.0))[0] > 0.99
    assert masks(replace(OPTIONS, darkest_shadow=0.7))[0] > 0.99  # this one leaves 0.6


def test_pictures_without_colour_have_no_shadows() -> None:
    """Everything darker would be one."""
    rng = np.random.default_rng(0)
    ground = place(rng, (120.0, 120.0, 120.0))
    model = StatisticalBackground(OPTIONS)
    for _ in range(20):
        model.apply(shown(ground, rng)[..., 0])
    ground[20:40, 30:50] *= 0.6
    assert (model.apply(shown(ground, rng)[..., 0])[20:40, 30:50] == 255).mean() > 0.99


@pytest.mark.parametrize("every", [1, 3, 6])
def test_rows_learn_in_turn_and_as_much(every: int) -> None:
    """After n frames a new colour's share is about 1 - (1 - alpha)^n whether learned in each frame or not."""
    rng = np.random.default_rng(1)
    ground = place(rng)
    options = BackgroundOptions(initial_frames=0, learning_rate=0.02, learn_every=every)
    model = StatisticalBackground(options)
    for _ in range(60):
        model.apply(shown(ground, rng))
    probability = model.background_probability()
    assert probability.mean() == pytest.approx(1.0 - 0.98**60, abs=0.01)


def test_all_rows_learn_after_a_change_of_light() -> None:
    """Shares grow in every frame until the background picture has followed."""
    rng = np.random.default_rng(1)
    ground = place(rng)
    model = StatisticalBackground(BackgroundOptions(initial_frames=10, learn_every=30))
    for _ in range(20):
        model.apply(shown(ground, rng))
    before = model.state()["static_gain"].copy()
    assert not model.apply(shown(1.3 * ground, rng)).any()
    assert np.all(model.state()["static_gain"] != before)
