"""The background model: hand-worked steps of learning, and what it finds."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from math import ceil, log
from typing import Literal

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground
from lumpwatch.models.trackers.background.model import without_small

Picture = NDArray[np.uint8]
FIXED = BackgroundOptions(
    least_change=10.0, largest_change=10.0, largest_light=0.0, least_area=1, initial_frames=0,
    learning_rate=0.1, once_off_share=0.8, learn_every=1, darkest_shadow=1.0,
)  # fmt: skip
"""Limits of change that do not depend on the picture, and no head start."""


def grey(level: int, shape: tuple[int, int] = (2, 2)) -> Picture:
    return np.full((*shape, 3), level, np.uint8)


def textured(rng: np.random.Generator, shape: tuple[int, int] = (40, 60)) -> Picture:
    return rng.integers(60, 190, (*shape, 3)).astype(np.uint8)


def noisy(picture: Picture, rng: np.random.Generator, sigma: float = 2.0) -> Picture:
    return np.clip(np.round(picture + rng.normal(0.0, sigma, picture.shape)), 0, 255).astype(np.uint8)


def weights(model: StatisticalBackground, field: str, k: int = 0) -> NDArray[np.float32]:
    """Probabilities of the static table k at pixel (0, 0)."""
    state = model.state()
    values: NDArray[np.float32] = state[f"static.{field}"][0, :, 0, k] / state["static_gain"][0, 0]
    return values


def prior(model: StatisticalBackground) -> float:
    return float(model.background_probability()[0, 0])


def test_gradual_learning_by_hand() -> None:
    """Eq. 10 three times from nothing: 1 - 0.9^3 = 0.271. Then a stranger: the first frame of it has moved and
    goes into the co-occurrences alone; by Eq. 11 the second has 0.1 and no part in the background, and
    everything else shrinks to nine tenths."""
    model = StatisticalBackground(FIXED)
    for _ in range(3):
        assert not model.apply(grey(100)).any()
    assert weights(model, "p")[:2] == pytest.approx([0.271, 0.0])
    assert weights(model, "joint")[:2] == pytest.approx([0.271, 0.0])
    assert prior(model) == pytest.approx(0.271)
    assert model.apply(grey(200)).all()
    assert weights(model, "p")[0] == pytest.approx(0.271)
    state = model.state()
    assert state["dynamic.p"][0, :2, 0, 0] / state["dynamic_gain"][0, 0] == pytest.approx([0.1, 0.0])
    assert not state["dynamic.joint"].any()
    assert model.apply(grey(200)).all()
    assert weights(model, "p")[:3] == pytest.approx([0.2439, 0.1, 0.0])
    assert weights(model, "joint")[:3] == pytest.approx([0.2439, 0.0, 0.0])
    assert prior(model) == pytest.approx(0.2439)
    # The gradient is the same in both: 0.271 * 0.9 + 0.1, of which 0.1 as foreground.
    assert weights(model, "p", 1)[0] == pytest.approx(0.3439)
    assert weights(model, "joint", 1)[0] == pytest.approx(0.2439)


@pytest.mark.parametrize(
    ("form", "joints", "expected_prior"), [("swap", [0.91, 0.0], 0.928), ("keep", [0.91, 0.072], 1.0)]
)
def test_once_off_change_by_hand(form: str, joints: list[float], expected_prior: float) -> None:
    """Colour 200 has p 0.9 as foreground, 100 has 0.08 as background. One more frame of 200 makes them
    0.91 and 0.072, and p(b) 0.072; 0.982 - 0.072 = 0.91 exceeds M = 0.8. Eq. 14 then makes 0.91 the joint
    of 200, and 0 that of 100, and p(b) 0.928; or all that was seen is background."""
    model = StatisticalBackground(FIXED)
    model.apply(grey(100))
    model.apply(grey(200))
    state = model.state()
    for name in ("static_gain", "dynamic_gain"):
        state[name][:] = 1.0
    state["static.v0"][:, :2, :, 0] = state["static.v1"][:, :2, :, 0] = state["static.v2"][:, :2, :, 0] = (
        np.array([200, 100])[None, :, None]
    )
    state["static.p"][:, 0], state["static.p"][:, 1] = [0.9, 0.98], [0.08, 0.0]
    state["static.joint"][:, 0], state["static.joint"][:, 1] = [0.0, 0.08], [0.08, 0.0]
    state["static_prior"][:] = 0.08
    model = StatisticalBackground.from_state(state, replace(FIXED, once_off=form))  # type: ignore[arg-type]
    assert model.apply(grey(200)).all()
    assert weights(model, "p")[:2] == pytest.approx([0.91, 0.072])
    assert weights(model, "joint")[:2] == pytest.approx(joints)
    assert prior(model) == pytest.approx(expected_prior)
    assert not model.apply(grey(200)).any()
    assert model.apply(grey(100)).all() == (form == "swap")


def test_probability_of_background_tends_to_one() -> None:
    """1 - (1 - alpha)^n wherever background is seen in every frame, whatever features it has."""
    rng = np.random.default_rng(1)
    place = textured(rng)
    model = StatisticalBackground(replace(FIXED, learning_rate=0.05))
    last = np.zeros((40, 60), np.float32)
    for n in range(1, 201):
        model.apply(noisy(place, rng, 1.0))
        now = model.background_probability()
        assert (now >= last).all() or n > 190
        last = now
    assert last == pytest.approx(1.0 - 0.95**200, abs=1e-4)


@pytest.mark.parametrize("form", ["keep", "swap"])
def test_object_that_stays_becomes_background_in_time(form: str) -> None:
    """Its share of the foreground passes M = 0.8 after log(0.2) / log(0.95) = 31.4 frames, so that the 33rd
    is background. What it uncovers when it leaves is known only if the old background was kept."""
    options = BackgroundOptions(learning_rate=0.05, once_off_share=0.8, once_off=form)  # type: ignore[arg-type]
    rng = np.random.default_rng(2)
    place = textured(rng)
    model = StatisticalBackground(options)
    for _ in range(40):
        model.apply(noisy(place, rng))
    stands = place.copy()
    stands[10:22, 20:35] = (30, 30, 220)
    inside = (slice(12, 20), slice(22, 33))
    seen = [float((model.apply(noisy(stands, rng))[inside] == 255).mean()) for _ in range(60)]
    needed = ceil(log(0.2) / log(0.95))
    assert min(seen[: needed - 1]) > 0.95
    assert max(seen[needed + 4 :]) < 0.05
    left = float((model.apply(noisy(place, rng))[inside] == 255).mean())
    assert left < 0.05 if form == "keep" else left > 0.95


def test_what_goes_to_and_fro_is_background_and_a_stranger_is_not() -> None:
    rng = np.random.default_rng(3)
    one, other = textured(rng), textured(rng)
    model = StatisticalBackground()
    for n in range(60):
        mask = model.apply(noisy(one if n % 4 < 2 else other, rng))
    assert (mask == 255).mean() < 0.01
    there = noisy(one, rng)
    there[10:25, 20:40] = (0, 250, 250)
    mask = model.apply(there)
    assert (mask[10:25, 20:40] == 255).all()
    mask[8:27, 18:42] = 0
    assert (mask == 255).mean() < 0.01


def test_light_that_changes_everywhere_is_no_foreground() -> None:
    rng = np.random.default_rng(4)
    place = textured(rng)
    changed = {}
    for largest_light in (60.0, 0.0):
        model = StatisticalBackground(BackgroundOptions(largest_light=largest_light))
        for _ in range(40):
            model.apply(noisy(place, rng))
        changed[largest_light] = float((model.apply(noisy(place + np.uint8(50), rng)) == 255).mean())
    assert changed[60.0] < 0.01
    assert changed[0.0] > 0.5


def test_frozen_model_learns_nothing() -> None:
    rng = np.random.default_rng(5)
    place = textured(rng)
    model = StatisticalBackground()
    for _ in range(35):
        model.apply(noisy(place, rng))
    before = model.state()
    stranger = place.copy()
    stranger[5:25, 5:25] = (250, 0, 0)
    for _ in range(3):
        assert (model.apply(noisy(stranger, rng), learn=False)[5:25, 5:25] == 255).all()
    after = model.state()
    assert not np.array_equal(before.pop("previous"), after.pop("previous"))  # the picture before the next
    for name, array in before.items():
        assert np.array_equal(array, after[name]), name


def test_masked_pixels_are_neither_reported_nor_learned() -> None:
    rng = np.random.default_rng(6)
    place = textured(rng)
    watched = np.ones((40, 60), np.uint8)
    watched[:, :30] = 0
    model = StatisticalBackground()
    for _ in range(35):
        model.apply(noisy(place, rng), mask=watched)
    stranger = place.copy()
    stranger[10:30, 20:40] = (250, 0, 0)
    mask = model.apply(stranger, mask=watched.astype(np.uint8))
    assert not mask[:, :30].any()
    assert (mask[10:30, 30:40] == 255).all()
    state = model.state()
    assert not state["static.p"][:, :, :30].any()
    assert not model.background_probability()[:, :30].any()
    assert model.background_probability()[:, 30:].min() > 0.9


def test_saved_model_goes_on_in_the_same_way() -> None:
    rng = np.random.default_rng(7)
    place = textured(rng)
    pictures = [noisy(place, rng, 8.0) for _ in range(60)]
    model = StatisticalBackground()
    for picture in pictures[:35]:
        model.apply(picture)
    file = BytesIO()
    np.savez(file, allow_pickle=False, **model.state())
    file.seek(0)
    with np.load(file, allow_pickle=False) as saved:
        again = StatisticalBackground.from_state(dict(saved))
    assert again.frames == 35
    for picture in pictures[35:]:
        assert np.array_equal(model.apply(picture), again.apply(picture))
    first, second = model.state(), again.state()
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_threads_do_not_matter() -> None:
    rng = np.random.default_rng(8)
    place = textured(rng)
    pictures = [noisy(place, rng, 10.0) for _ in range(40)]
    one, two = (StatisticalBackground(BackgroundOptions(threads=n, least_change=5.0)) for n in (1, 2))
    for picture in pictures:
        assert np.array_equal(one.apply(picture), two.apply(picture))
    first, second = one.state(), two.state()
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_options_change_while_it_runs() -> None:
    """The copy goes on by itself, with its own parameters; the original stays as it was."""
    rng = np.random.default_rng(9)
    place = textured(rng)
    model = StatisticalBackground()
    for _ in range(35):
        model.apply(noisy(place, rng))
    before = model.state()
    spot = place.copy()
    spot[10:13, 10:13] = (250, 0, 0)
    finer = model.with_options(replace(model.options, least_area=1))
    assert (finer.apply(spot)[10:13, 10:13] == 255).all()
    assert all(np.array_equal(before[name], array) for name, array in model.state().items())
    assert not model.apply(spot).any()
    with pytest.raises(ValueError, match="static_kept cannot change"):
        model.with_options(replace(model.options, static_kept=30))


def test_grey_pictures_and_the_background_picture() -> None:
    rng = np.random.default_rng(10)
    place = textured(rng)[..., 0]
    model = StatisticalBackground()
    for _ in range(60):
        model.apply(noisy(place, rng))
    assert np.abs(model.background().astype(float) - place[..., np.newaxis]).mean() < 1.0
    stranger = place.copy()
    stranger[5:20, 5:20] = 255
    assert (model.apply(stranger)[6:19, 6:19] == 255).all()


def test_small_regions_are_removed() -> None:
    mask = np.zeros((20, 20), np.uint8)
    mask[2:5, 2:7] = 255  # 15 pixels
    mask[10:12, 2:9] = 255  # 14
    mask[15, 15] = mask[16, 16] = 255
    kept = without_small(mask, 15)
    assert kept[2:5, 2:7].all()
    assert kept.sum() == 15 * 255
    assert np.array_equal(without_small(mask, 1), mask)


def test_regions_are_those_of_opencv() -> None:
    rng = np.random.default_rng(2)
    for share in (0.05, 0.3, 0.45):
        mask = np.where(rng.random((50, 70)) < share, 255, 0).astype(np.uint8)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        large = stats[:, cv2.CC_STAT_AREA] >= 15
        large[0] = False
        assert np.array_equal(without_small(mask, 15) == 255, large[labels])


def test_more_regions_than_short_labels_can_tell() -> None:
    """A dot in each block of 2 x 2 pixels, 90,000 of them, and one region of 16 pixels."""
    mask = np.zeros((600, 600), np.uint8)
    mask[::2, ::2] = 255
    mask[-4:, -4:] = 255
    kept = without_small(mask, 15)
    assert kept[-4:, -4:].all()
    assert kept.sum() == 16 * 255


def test_memory_is_stated() -> None:
    model = StatisticalBackground()
    assert model.nbytes == 0
    model.apply(grey(100, (30, 40)))
    # 15 ranks of two entries of 12 bytes, 25 of 16, background, last picture, four floats.
    assert model.nbytes == 30 * 40 * (15 * 24 + 25 * 16 + 12 + 3 + 16)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate=st.floats(0.001, 0.5),
    share=st.floats(0.55, 0.95),
    rule=st.sampled_from(["either", "paper"]),
    once_off=st.sampled_from(["keep", "swap"]),
)
def test_tables_stay_sorted_and_probabilities_stay_probabilities(
    seed: int,
    rate: float,
    share: float,
    rule: Literal["either", "paper"],
    once_off: Literal["keep", "swap"],
) -> None:
    rng = np.random.default_rng(seed)
    options = BackgroundOptions(
        static_used=3, static_kept=5, dynamic_used=3, dynamic_kept=5, learning_rate=rate, initial_rate=rate,
        initial_frames=5, once_off_share=share, rule=rule, once_off=once_off,
    )  # fmt: skip
    model = StatisticalBackground(options)
    palette = rng.integers(0, 256, (4, 3)).astype(np.uint8)
    for _ in range(60):
        model.apply(palette[rng.choice(4, (6, 7), p=[0.7, 0.2, 0.05, 0.05])])
    state = model.state()
    for kind in ("static", "dynamic"):
        gain = state[f"{kind}_gain"][:, np.newaxis, :, np.newaxis]
        p, joint = state[f"{kind}.p"] / gain, state[f"{kind}.joint"] / gain
        b = state[f"{kind}_prior"] / gain[:, 0, :, 0]
        assert (np.diff(p, axis=1) <= 0.0).all()
        assert (joint >= 0.0).all()
        assert (joint <= p * (1 + 1e-5)).all()
        assert p.sum(axis=1).max() <= 1.0 + 1e-4
        assert b.min() >= 0.0
        assert b.max() <= 1.0 + 1e-4
        assert (joint.sum(axis=1) <= b[..., np.newaxis] + 1e-4).all()
