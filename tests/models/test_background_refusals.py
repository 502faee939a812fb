"""What the background model refuses, and how it says so."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (np.zeros((10, 10, 3)), "must be uint8, not float64"),
        (np.zeros((10, 10, 4), np.uint8), "not \\(10, 10, 4\\)"),
        (np.zeros(10, np.uint8), "not \\(10,\\)"),
        (np.zeros((1, 10, 3), np.uint8), "too small"),
        (np.zeros((12, 10, 3), np.uint8), "with \\(10, 10\\)"),
    ],
)
def test_unfit_pictures_are_refused(picture: NDArray[np.uint8], words: str) -> None:
    model = StatisticalBackground()
    model.apply(np.zeros((10, 10, 3), np.uint8))
    before = model.state()
    with pytest.raises(ValueError, match=words):
        model.apply(picture)
    assert all(np.array_equal(before[name], array) for name, array in model.state().items())


@pytest.mark.parametrize("mask", [np.ones((9, 10), np.uint8), np.ones((10, 10))])
def test_unfit_masks_are_refused(mask: NDArray[np.uint8]) -> None:
    with pytest.raises(ValueError, match="mask must be uint8"):
        StatisticalBackground().apply(np.zeros((10, 10, 3), np.uint8), mask=mask)


def test_nothing_to_tell_before_the_first_picture() -> None:
    model = StatisticalBackground()
    for ask in (model.background, model.background_probability, model.state):
        with pytest.raises(ValueError, match="no picture yet"):
            ask()


def test_unfit_states_are_refused() -> None:
    model = StatisticalBackground()
    model.apply(np.full((4, 5, 3), 100, np.uint8))
    good = model.state()
    with pytest.raises(ValueError, match=r"missing or unknown: static\.p$"):
        StatisticalBackground.from_state({name: a for name, a in good.items() if name != "static.p"})
    with pytest.raises(ValueError, match="background is missing"):
        StatisticalBackground.from_state({"levels": good["levels"]})
    with pytest.raises(ValueError, match="levels None"):
        StatisticalBackground.from_state({})
    with pytest.raises(ValueError, match=r"levels \[256  32\].* \[256  64\]"):
        StatisticalBackground.from_state(good, BackgroundOptions(dynamic_levels=64))
    with pytest.raises(ValueError, match=r"^background .*grey levels"):
        StatisticalBackground.from_state(good | {"background": good["background"] + np.float32(200)})
    with pytest.raises(ValueError, match=r"static_gain .*positive"):
        StatisticalBackground.from_state(good | {"static_gain": np.zeros((4, 5), np.float32)})
    with pytest.raises(ValueError, match=r"static.* these options need"):
        StatisticalBackground.from_state(good, BackgroundOptions(static_kept=30))
    with pytest.raises(ValueError, match="previous is float64"):
        StatisticalBackground.from_state(good | {"previous": good["previous"].astype(float)})
    with pytest.raises(ValueError, match=r"static_prior .*finite"):
        StatisticalBackground.from_state(good | {"static_prior": np.full((4, 5), np.nan, np.float32)})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("static_levels", 100), ("dynamic_levels", 4), ("static_used", 15), ("dynamic_kept", 256),
        ("learning_rate", 0.0), ("initial_rate", 0.6), ("background_rate", 1.5), ("once_off_share", 0.5),
        ("once_off", "turn"), ("rule", "both"), ("noise_floor", -1.0), ("change_sigmas", float("nan")),
        ("least_change", 50.0), ("least_area", 0), ("threads", 0), ("largest_light", -1.0),
        ("learn_every", 0), ("darkest_shadow", 0.0), ("darkest_shadow", 1.1), ("shadow_noise", -1.0),
    ],
)  # fmt: skip
def test_unfit_options_are_refused(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=name):
        BackgroundOptions(**{name: value})  # type: ignore[arg-type]
