"""The lump likelihood's features against plain NumPy, under changes of light, and its score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.likelihood.lump import (
    FEATURES,
    MEASURES,
    WEIGHTS,
    LumpLikelihood,
    LumpObservation,
    expand,
    standardised,
)
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns
from lumpwatch.models.roi import Image
from tests.models.helpers import (
    box,
    boxes,
    gradients,
    inside_share_of_noise,
    patches_on_noise,
    whole_picture,
)

Array = NDArray[np.float64]
M, EIGHT = len(FEATURES), len(MEASURES)
NOISE = 2.0
"""Grey levels that keep ratios finite, as in the module under test."""


def likelihood(weights: Array | None = None, offset: float = 0.0, bound: float = np.inf) -> LumpLikelihood:
    weights = np.zeros(WEIGHTS) if weights is None else weights
    return LumpLikelihood(np.zeros(M), np.ones(M), weights, offset, 1.0, bound)


def observe(gray: Image) -> LumpObservation:
    return likelihood().observe(whole_picture(gray).view(gray))


def region(shape: tuple[int, ...], x0: float, y0: float, x1: float, y1: float) -> NDArray[np.bool_]:
    """The pixels of a box with whole edges."""
    mask = np.zeros(shape, np.bool_)
    mask[max(round(y0), 0) : max(round(y1), 0), max(round(x0), 0) : max(round(x1), 0)] = True
    return mask


def brute_features(gray: Image, x: int, y: int, w: int, h: int) -> list[float]:
    """The eight measures from pixel masks; edges are whole for w and h that are multiples of 20."""

    def scaled(factor: float) -> NDArray[np.bool_]:
        a, b = factor * w / 2, factor * h / 2
        return region(gray.shape, x - a, y - b, x + a, y + b)

    whole, inner, ring = scaled(1.0), scaled(0.7), scaled(1.5) & ~scaled(1.0)
    band = scaled(1.2) & ~inner
    light = gray.astype(float)
    gradient = sum(gradients(light, 1))
    gap = light[inner].mean() - light[ring].mean()
    noise = light[ring].std() + NOISE
    rows, columns = np.nonzero(whole)
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    r, c = np.mgrid[: gray.shape[0], : gray.shape[1]]
    level = (r >= top) & (r <= bottom)
    upright = (c >= left) & (c <= right)
    sides = [level & (c < left), level & (c > right), upright & (r < top), upright & (r > bottom)]
    sign = 1.0 if gap >= 0 else -1.0
    against = [
        sign * (light[inner].mean() - light[side & ring].mean()) / noise
        for side in sides
        if (side & ring).any()
    ]
    texture, around = gradient[inner].mean(), gradient[ring].mean()
    return [
        gap / noise,
        abs(gap) / noise,
        min(against),
        np.log((texture + NOISE) / (around + NOISE)),
        np.log((gradient[band].mean() + NOISE) / (texture + NOISE)),
        np.log((light[inner].std() + NOISE) / noise),
        np.log((texture + NOISE) / noise),
        np.log((around + NOISE) / noise),
    ]


@settings(max_examples=60, deadline=None)
@given(patches_on_noise(), st.integers(10, 110), st.integers(10, 80), *[st.sampled_from([20, 40])] * 2)
def test_features_against_brute_force(gray: Image, x: int, y: int, w: int, h: int) -> None:
    """Boxes anywhere in the picture, rings that leave it included."""
    features, valid = observe(gray).features(boxes(1, x, y, w, h))
    assert valid[0] == (inside_share_of_noise(x, y, w, h) >= 0.75)
    if valid[0]:
        assert features[0, :EIGHT] == pytest.approx(brute_features(gray, x, y, w, h), abs=1e-6)
    else:
        assert np.array_equal(features[0], np.zeros(M))


def test_features_of_a_large_box_in_a_bright_picture() -> None:
    """The squares of 300 x 300 px near white sum to more than 2^32."""
    gray = np.random.default_rng(0).integers(225, 256, (320, 340)).astype(np.uint8)
    features, valid = observe(gray).features(boxes(1, 170, 160, 200, 200))
    assert valid.all()
    assert features[0, :EIGHT] == pytest.approx(brute_features(gray, 170, 160, 200, 200), abs=1e-6)


def rubble_with_lump(seed: int = 0) -> Image:
    """Rough ground from 60 to 140, and a smooth bright patch of 40 x 40 px around (60, 50)."""
    rng = np.random.default_rng(seed)
    gray = rng.integers(60, 141, (100, 120))
    gray[30:70, 40:80] = rng.integers(130, 141, (40, 40))
    return gray.astype(np.uint8)


LUMP, GROUND = box(40, 30, 80, 70), box(4, 4, 34, 34)


def test_features_tell_what_they_are_named_after() -> None:
    gray = rubble_with_lump()
    features, valid = observe(gray).features(np.concatenate([LUMP, GROUND]))
    lump, ground = (dict(zip(FEATURES, row, strict=True)) for row in features)
    assert valid.all()
    assert lump["brightness"] > 1
    assert lump["weakest_side"] > 1
    assert lump["texture"] < -0.5
    assert lump["outline"] > 0.5
    assert lump["spread"] < -0.5
    assert lump["core_texture"] < ground["core_texture"]
    for name in ("brightness", "weakest_side", "texture", "outline", "spread"):
        assert abs(ground[name]) < 0.35, name


def test_dark_lump_mirrors_the_bright_one() -> None:
    """The negative picture: what tells of brightness changes its sign, everything else stays."""
    gray = rubble_with_lump()
    bright = observe(gray).features(LUMP)[0][0]
    dark = observe(np.uint8(255) - gray).features(LUMP)[0][0]
    signs = np.array([-1.0 if name.startswith("brightness") else 1.0 for name in FEATURES])
    assert dark == pytest.approx(signs * bright, abs=1e-9)


@pytest.mark.parametrize("offset", [-50, 30, 110])
def test_offset_of_light_cancels(offset: int) -> None:
    gray = rubble_with_lump()
    states = np.concatenate([LUMP, GROUND])
    shifted = (gray.astype(int) + offset).astype(np.uint8)
    assert np.allclose(observe(shifted).features(states)[0], observe(gray).features(states)[0], atol=1e-6)


@pytest.mark.parametrize("gain", [0.6, 1.5])
def test_gain_of_light_hardly_changes_the_features(gain: float) -> None:
    """Only the two grey levels of noise and rounding are left: within a fifth of the value, or 0.05."""
    gray = rubble_with_lump()
    brighter = np.round(gray * gain).astype(np.uint8)
    before, after = (observe(picture).features(LUMP)[0][0] for picture in (gray, brighter))
    assert np.all(np.abs(after - before) <= np.maximum(0.2 * np.abs(before), 0.05))


def test_flat_picture_has_finite_features() -> None:
    features, valid = observe(np.full((60, 60), 80, np.uint8)).features(box(20, 20, 40, 40))
    assert valid.all()
    assert features[0] == pytest.approx(np.zeros(M), abs=1e-9)


def test_box_that_leaves_the_polygon_is_penalised() -> None:
    """Less than three quarters inside: the score is -inf and the log ratio the bound."""
    gray = rubble_with_lump()
    seen = likelihood(offset=1.5, bound=3.0).observe(whole_picture(gray).view(gray))
    states = np.concatenate([box(-4, 20, 16, 40), box(-6, 20, 14, 40), box(200, 20, 220, 40)])
    assert np.array_equal(seen.score(states), [1.5, -np.inf, -np.inf])
    assert np.array_equal(seen.log_ratio(states), [1.5, -3.0, -3.0])


def test_a_frame_counts_by_the_time_since_the_last() -> None:
    """Two looks a second: a fifth of the ratio after 0.1 s, all of it after half a second and more."""
    view = whole_picture(rubble_with_lump()).view(rubble_with_lump())
    states = box(20, 20, 60, 60)
    model = replace(likelihood(offset=1.5, bound=9.0), looks_per_s=2.0)
    for dt, share in ((0.1, 0.2), (0.5, 1.0), (30.0, 1.0)):
        assert model.observe(view, dt).log_ratio(states) == pytest.approx([1.5 * share])


@pytest.mark.parametrize(("w", "h"), [(2.9, 20.0), (20.0, 2.9)])
def test_slivers_are_no_objects(w: float, h: float) -> None:
    assert not observe(rubble_with_lump()).features(boxes(1, 60, 50, w, h))[1].any()


@pytest.mark.parametrize("count", [0, 3])
def test_score_is_the_logistic_of_the_features(count: int) -> None:
    rng = np.random.default_rng(1)
    patterns = Patterns(rng.normal(size=(count, M)), rng.normal(size=count))
    model = LumpLikelihood(
        rng.normal(size=M),
        rng.uniform(0.5, 2, M),
        rng.normal(size=WEIGHTS + count),
        0.7,
        0.3,
        1.0,
        patterns=patterns,
        margin=0.5,
    )
    unbounded = replace(model, bound=np.inf)
    gray = rubble_with_lump()
    seen = model.observe(whole_picture(gray).view(gray))
    for state in (LUMP, GROUND):
        z = (seen.features(state)[0][0] - model.mean) / model.scale
        z = np.array([min(max(value, -5.0), 5.0) for value in z])
        along = [
            sum(a * b for a, b in zip(row, z, strict=True)) for row in patterns.directions
        ] + patterns.offsets
        squashed = [value / (1.0 + abs(value)) for value in along]
        logit = sum(w * v for w, v in zip(model.weights, [*z, *z**2, *squashed], strict=True)) + 0.7
        close = 1e-6 if count else 1e-9  # patterns are told in single precision
        assert seen.score(state)[0] == pytest.approx(logit, abs=close)
        assert seen.log_ratio(state)[0] == pytest.approx(min(max(0.3 * (logit - 0.5), -1.0), 1.0), abs=close)
        whole = unbounded.observe(whole_picture(gray).view(gray)).log_ratio(state)[0]
        assert whole == pytest.approx(0.3 * (logit - 0.5), abs=close)


def test_expand_by_hand() -> None:
    """(7 - 1) / 2 = 3 and its square 9; (100 - 0) / 1 is limited to 5, and 25; 3 - 5 - 2 = -4 gives -4 / 5."""
    z = standardised(np.array([[7.0, 100.0]]), np.array([1.0, 0.0]), np.array([2.0, 1.0]))
    assert np.array_equal(expand(z, no_patterns(2)), [[3.0, 5.0, 9.0, 25.0]])
    patterns = Patterns(np.array([[1.0, -1.0]]), np.array([-2.0]))
    assert np.array_equal(expand(z, patterns), [[3.0, 5.0, 9.0, 25.0, -0.8]])


def test_next_picture_replaces_the_last() -> None:
    """The reused memory keeps nothing of the picture before, nor of one with another size."""
    model = likelihood()
    for picture in (rubble_with_lump(1), rubble_with_lump(2), rubble_with_lump(3)[:90, :100].copy()):
        reused = model.observe(whole_picture(picture).view(picture)).features(LUMP)[0]
        assert np.array_equal(reused, observe(picture).features(LUMP)[0])
