"""Measures of the picture's quality against what is known of made pictures."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.picture.activity import Activity
from lumpwatch.models.picture.measures import SATURATED, PictureMeter
from lumpwatch.models.picture.medians import JumpDetector, SlowMedian
from lumpwatch.models.picture.pattern import learn_pattern
from lumpwatch.models.picture.reference import THUMB_WIDTH, moving_mask, thumbnail
from lumpwatch.models.picture.region import DEFAULTS, Measure, Sample, learn_region, values
from lumpwatch.models.picture.registration import Registration
from lumpwatch.models.picture.tail import lower_threshold, upper_threshold
from lumpwatch.models.roi import Image
from lumpwatch.service.simulator.codec import ThinLink
from lumpwatch.service.simulator.spec import FeedSpec

SHAPE = (240, 320)
MASK = np.ones(SHAPE, np.uint8)


def texture(seed: int = 0, shape: tuple[int, int] = SHAPE, contrast: float = 30.0) -> Image:
    """Structure of all sizes around a level of 100."""
    rng = np.random.default_rng(seed)
    field = sum(
        cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), sigma) * sigma for sigma in (0.8, 2.0, 5.0)
    )
    # Structure is not the same everywhere, as on a belt: a tenth of it is flat.
    field *= np.linspace(0.0, 1.4, shape[1])[None]
    return np.clip(100 + contrast * field / field.std(), 0, 255).astype(np.uint8)


def noisy(picture: Image, sigma: float, seed: int = 1) -> Image:
    noise = np.random.default_rng(seed).normal(0.0, sigma, picture.shape)
    return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)


# Levels


def test_levels_are_those_of_the_pixels_inside() -> None:
    mask = np.zeros(SHAPE, np.uint8)
    mask[:, :160] = 1
    picture = np.full(SHAPE, 255, np.uint8)
    picture[:, :160] = 40
    picture[:60, :160] = 240  # a quarter of what is inside
    measures = PictureMeter(mask).measure(picture)
    assert measures.mean == pytest.approx(0.75 * 40 + 0.25 * 240)
    assert (measures.dark, measures.bright) == (40.0, 240.0)
    assert measures.saturated == pytest.approx(0.25)
    assert SATURATED == 235
    assert measures.contrast == pytest.approx(200 / 90)


def test_a_uniform_picture_has_no_structure() -> None:
    measures = PictureMeter(MASK).measure(np.full(SHAPE, 90, np.uint8))
    assert (measures.sharpness, measures.structure, measures.contrast) == (0.0, 0.0, 0.0)


# Sharpness


def test_sharpness_falls_with_blur() -> None:
    meter, picture = PictureMeter(MASK), texture()
    found = [meter.measure(picture).sharpness]
    found += [
        meter.measure(np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)).sharpness
        for sigma in (1.0, 2.0, 3.0, 4.0, 6.0)
    ]
    assert all(sharper > 1.2 * softer for sharper, softer in pairwise(found))


def test_noise_does_not_make_a_blurred_picture_sharp() -> None:
    meter, picture = PictureMeter(MASK), texture()
    soft = np.asarray(cv2.GaussianBlur(picture, (0, 0), 4.0), np.uint8)
    sharp = meter.measure(picture).sharpness
    assert meter.measure(noisy(soft, 8.0)).sharpness < 0.5 * sharp
    assert meter.measure(noisy(picture, 8.0)).sharpness == pytest.approx(sharp, rel=0.15)


def test_sharpness_does_not_depend_on_contrast() -> None:
    meter = PictureMeter(MASK)
    strong, weak = meter.measure(texture(contrast=30.0)), meter.measure(texture(contrast=10.0))
    assert weak.sharpness == pytest.approx(strong.sharpness, rel=0.1)
    assert weak.structure == pytest.approx(strong.structure / 3, rel=0.1)


# Frozen or still


def clocked(picture: Image, second: int) -> Image:
    stamped = picture.copy()
    stamped[2:18, 4:60] = 0
    cv2.putText(stamped, f"{second:04d}", (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1)
    return stamped


def run(pictures: list[Image], interval_s: float = 0.2, window_s: float = 2.0) -> float:
    """The last value."""
    activity = Activity(window_s)
    found = [activity.add(k * interval_s, one) for k, one in enumerate(pictures)]
    assert found[0] is None
    assert found[-1] is not None
    return found[-1]


def test_a_frozen_picture_has_no_activity_though_its_clock_runs() -> None:
    picture = texture()
    assert run([picture] * 20) == 0.0
    assert run([clocked(picture, k // 5) for k in range(20)]) == 0.0


def test_a_stopped_belt_under_a_live_sensor_has_its_noise() -> None:
    # |a - b| of two normal variables of deviation s has the mean 2 s / sqrt(pi); the largest of ten is above it.
    pictures = [noisy(texture(), 1.5, seed=k) for k in range(20)]
    assert 1.0 * 2 * 1.5 / np.sqrt(np.pi) < run(pictures) < 1.6 * 2 * 1.5 / np.sqrt(np.pi)


def test_pictures_that_skip_until_the_key_frame_are_alive() -> None:
    # The coder sends nothing for what stands still; each key frame, once in 1.6 s, shows new noise.
    pictures = [noisy(texture(), 1.5, seed=k // 8) for k in range(40)]
    assert run(pictures[:38]) > 1.0


def recoded(pictures: list[Image], crf: int) -> list[Image]:
    """As they come from a recorder that codes them again, with a key frame each second."""
    height, width = pictures[0].shape
    link = ThinLink(FeedSpec(width=width, height=height, fps=5.0, h264_crf=crf))
    return [np.asarray(link.through(one, k), np.uint8) for k, one in enumerate(pictures)]


@pytest.mark.parametrize("crf", [20, 26, 32, 38])
def test_a_frozen_picture_that_is_coded_again_comes_back_though_it_changes(crf: int) -> None:
    shown = recoded([noisy(texture(), 2.0)] * 20, crf)
    changes = [np.abs(a.astype(float) - b).mean() for a, b in pairwise(shown)]
    assert max(changes) > 0.4  # more than the quietest sensor below
    assert run(shown) == 0.0


@pytest.mark.parametrize("sigma", [0.2, 0.5, 2.0])
@pytest.mark.parametrize("crf", [26, 32])
def test_a_still_scene_of_a_live_sensor_never_comes_back_however_it_is_coded(sigma: float, crf: int) -> None:
    # A fifth of a grey level is less than any sensor has.
    rough = noisy(texture(), 2.0)
    assert run(recoded([noisy(rough, sigma, seed=k) for k in range(20)], crf)) > 0.3


def test_a_picture_that_comes_again_after_others_is_not_new() -> None:
    loop = [noisy(texture(), 1.0, seed=k % 4) for k in range(30)]
    assert run(loop) == 0.0
    long = [noisy(texture(), 1.0, seed=k % 40) for k in range(60)]  # eight seconds: as good as new
    assert run(long) > 0.8


def test_pictures_that_seldom_come_are_compared_and_another_size_begins_anew() -> None:
    activity = Activity(2.0)
    activity.add(0.0, texture())
    assert activity.add(0.2, texture(1)) is not None
    assert (activity.add(9.0, texture(2)) or 0.0) > 1.0
    assert activity.add(18.0, texture(2)) == 0.0
    assert activity.add(18.2, texture(2, (120, 160))) is None


# Registration


def scene(x: float = 0.0, y: float = 0.0, seed: int = 3) -> Image:
    """A still scene (120, 160), moved to the right by x and down by y."""
    rng = np.random.default_rng(seed)
    large = np.zeros((200, 260), np.uint8)
    for _ in range(90):
        corner = rng.integers(0, (260, 200))
        size = rng.integers(6, 40, 2)
        cv2.rectangle(large, corner.tolist(), (corner + size).tolist(), int(rng.integers(20, 230)), -1)
    matrix = np.array([[1.0, 0.0, x - 50], [0.0, 1.0, y - 40]])
    return np.asarray(cv2.warpAffine(large, matrix, (160, 120)), np.uint8)


NOTHING_MOVES = np.zeros((120, 160), np.uint8)


@pytest.mark.parametrize(
    ("x", "y"), [(0.0, 0.0), (0.5, -0.25), (1.5, -1.0), (-3.3, 2.6), (6.0, 3.0), (12.0, -8.0)]
)
def test_a_known_shift_is_recovered(x: float, y: float) -> None:
    found = Registration(scene(), NOTHING_MOVES).shift(noisy(scene(x, y), 2.0))
    assert (found.x, found.y) == pytest.approx((x, y), abs=0.25)
    assert found.response > 0.2


def test_light_does_not_move_the_picture() -> None:
    lit = np.clip(scene(2.0, 1.0) * np.linspace(0.4, 1.0, 160)[None], 0, 255).astype(np.uint8)
    found = Registration(scene(), NOTHING_MOVES).shift(lit)
    assert (found.x, found.y) == pytest.approx((2.0, 1.0), abs=0.15)


def test_moving_ore_does_not_pull() -> None:
    corners = np.array([[0.25, 0.0], [0.75, 0.0], [0.75, 1.0], [0.25, 1.0]])
    mask = moving_mask([corners], (120, 160))
    registration = Registration(scene(), mask)
    for k in range(4):
        picture = scene(1.5, 0.0)
        picture[:, 40:120] = scene(0.0, 7.0 * k, seed=9)[:, 40:120]  # ore that runs down the belt
        found = registration.shift(picture)
        assert (found.x, found.y) == pytest.approx((1.5, 0.0), abs=0.3)


def test_registration_refuses_other_sizes() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Registration(scene(), np.zeros((10, 10), np.uint8))
    with pytest.raises(ValueError, match="cannot be registered"):
        Registration(scene(), NOTHING_MOVES).shift(np.zeros((60, 80), np.uint8))


def test_a_still_without_anything_in_it_is_registered_without_failing() -> None:
    grey = np.full((120, 160), 128, np.uint8)
    found = Registration(grey, NOTHING_MOVES).shift(grey)
    assert np.isfinite([found.x, found.y]).all()


@pytest.mark.parametrize("size", [(480, 640), (1080, 1920), (90, 120)])
def test_a_thumbnail_is_the_mean_of_its_blocks(size: tuple[int, int]) -> None:
    ramp = np.tile(np.linspace(0, 255, size[1]), (size[0], 1)).astype(np.uint8)
    thumb = thumbnail(ramp)
    width = min(THUMB_WIDTH, size[1])
    assert thumb.shape == (round(size[0] * width / size[1]), width)
    expected = (np.arange(width) + 0.5) / width * 255
    assert np.abs(thumb.mean(axis=0) - expected).max() < 2.0


# Slow estimates and jumps


def test_less_than_half_of_the_values_change_no_median() -> None:
    slow = SlowMedian(1.0)
    found = [slow.add(0.1 * k, 100.0 if 13 <= k < 17 else 1.0) for k in range(40)]
    assert set(found) == {1.0}
    assert slow.count == 10
    assert slow.spread == 0.0


def test_old_values_leave_the_window() -> None:
    slow = SlowMedian(1.0)
    slow.add(0.0, 5.0)
    assert slow.add(1.0, 9.0) == 9.0


def test_a_jump_is_told_once_and_a_slow_change_never() -> None:
    watch = JumpDetector(1.3)
    assert not any(watch.add(0.2 * k, 100 * 1.02**k) for k in range(50))
    watch = JumpDetector(1.3)
    levels = [100.0] * 10 + [140.0] * 10 + [100.0] * 10
    told = [k for k, level in enumerate(levels) if watch.add(0.2 * k, level)]
    # For half a second the level before is remembered: the second and third pictures still stand out.
    assert told == [10, 11, 20, 21]


# Thresholds


def test_a_threshold_is_the_quantile_of_a_long_record() -> None:
    rng = np.random.default_rng(0)
    # Of an exponential variable a share p lies above -ln p.
    found = [upper_threshold(rng.exponential(1.0, 600), 1e-3) for _ in range(60)]
    assert np.median(found) == pytest.approx(-np.log(1e-3), rel=0.15)
    # A uniform one ends at 1: the fit must not run far beyond.
    found = [upper_threshold(rng.uniform(0.0, 1.0, 600), 1e-3) for _ in range(60)]
    assert max(found) < 1.1


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=50), st.floats(1e-5, 0.05))
def test_thresholds_lie_beyond_all_that_was_seen(seen: list[float], share: float) -> None:
    assert upper_threshold(seen, share) >= max(seen)
    assert lower_threshold(seen, share) <= min(seen)


def test_thresholds_need_values() -> None:
    with pytest.raises(ValueError, match="needs values"):
        upper_threshold([], 1e-3)


# Patterns and references


def clip(count: int = 25, seed: int = 0) -> list[Sample]:
    """A belt: other texture in each picture under the same light, with noise."""
    meter, activity = PictureMeter(MASK), Activity(2.0)
    light = np.linspace(0.7, 1.3, SHAPE[0])[:, None]
    samples = []
    for k in range(count):
        picture = noisy(np.clip(texture(seed + k) * light, 0, 255).astype(np.uint8), 2.0, k)
        samples.append(Sample(0.2 * k, meter.measure(picture), activity.add(0.2 * k, picture)))
    return samples


def test_a_reference_finds_its_own_footage_fit_and_a_cover_strange() -> None:
    reference = learn_region([clip()], 1e-3, 2.0)
    for sample in clip(6, seed=500):
        for measure, value in values(sample.measures, sample.activity, reference.pattern).items():
            threshold = reference.thresholds[measure]
            assert (value <= threshold) if measure.too_large else (value >= threshold), measure
    covered = texture(900)
    covered[:, :200] = 60
    measures = PictureMeter(MASK).measure(noisy(covered, 2.0))
    assert reference.pattern.strange(measures) > reference.thresholds[Measure.STRANGE]
    assert set(reference.thresholds) == set(Measure)


def test_ore_that_passed_once_is_not_strange_when_the_belt_stops_with_it() -> None:
    samples = clip(120)
    bare = texture(70)
    bare[:, :100] = 60  # a third of the region without stones
    measures = PictureMeter(MASK).measure(noisy(bare, 2.0))
    samples[70] = replace(samples[70], measures=measures)
    reference = learn_region([samples], 1e-3, 2.0)
    assert 0.2 < reference.pattern.strange(measures) < reference.thresholds[Measure.STRANGE] < 0.5


def test_a_belt_that_never_stopped_leaves_room_for_one_that_does() -> None:
    assert learn_region([clip()], 1e-3, 2.0).thresholds[Measure.ACTIVITY] == 0.25


def test_footage_that_stands_still_leaves_only_bits_to_judge() -> None:
    meter, activity = PictureMeter(MASK), Activity(2.0)
    picture = texture()
    samples = [Sample(0.2 * k, meter.measure(picture), activity.add(0.2 * k, picture)) for k in range(30)]
    assert learn_region([samples], 1e-3, 2.0).thresholds[Measure.ACTIVITY] == DEFAULTS[Measure.ACTIVITY]


def test_a_reference_needs_two_pictures() -> None:
    with pytest.raises(ValueError, match="no picture"):
        learn_pattern([])
    with pytest.raises(ValueError, match="close enough"):
        learn_region([clip(1)], 1e-3, 2.0)
