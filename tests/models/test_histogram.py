"""The histogram likelihood: bins, integral histogram, Bhattacharyya distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.likelihood.histogram import BINS, HistogramLikelihood, bin_image, histogram
from lumpwatch.models.roi import Image, make_roi
from lumpwatch.models.state import States
from tests.models.helpers import box, whole_picture

Array = NDArray[np.float64]
EVEN = np.full(BINS, 1 / BINS)


def likelihood(reference: Array = EVEN, offset: float = 0.0, slope: float = 1.0) -> HistogramLikelihood:
    return HistogramLikelihood(reference, offset, slope, 1.0, np.inf)


@st.composite
def pictures(draw: st.DrawFn) -> Image:
    """Random brightness, coarse or fine, in pictures of any small shape."""
    shape = draw(st.integers(8, 30)), draw(st.integers(8, 30))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return rng.integers(0, draw(st.sampled_from([1, 40, 256])), shape).astype(np.uint8)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Image, tuple[int, int, int, int]]:
    """A picture and the edges of a box in it that is not empty."""
    gray = draw(pictures())
    height, width = gray.shape
    x0, y0 = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    return gray, (x0, y0, draw(st.integers(x0 + 1, width)), draw(st.integers(y0 + 1, height)))


def brute_histogram(gray: Image, edges: tuple[int, int, int, int]) -> Array:
    """Count pixel by pixel."""
    counts = np.zeros(BINS)
    x0, y0, x1, y1 = edges
    for value in gray[y0:y1, x0:x1].ravel():
        counts[int(value) // 16] += 1
    return counts / counts.sum()


@settings(max_examples=60, deadline=None)
@given(scenes())
def test_histogram_of_a_box_against_counting(scene: tuple[Image, tuple[int, int, int, int]]) -> None:
    gray, edges = scene
    seen = likelihood().observe(whole_picture(gray).view(gray))
    assert np.allclose(histogram(seen.integral, box(*edges)[0]), brute_histogram(gray, edges), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(scenes(), st.lists(st.floats(0, 1), min_size=BINS, max_size=BINS))
def test_distance_against_a_direct_sum(
    scene: tuple[Image, tuple[int, int, int, int]], weights: list[float]
) -> None:
    gray, edges = scene
    reference = (np.array(weights) + 1e-3) / (np.sum(weights) + BINS * 1e-3)
    seen = likelihood(reference).observe(whole_picture(gray).view(gray))
    direct = 1.0 - sum(np.sqrt(p * q) for p, q in zip(brute_histogram(gray, edges), reference, strict=True))
    assert seen.distance(box(*edges))[0] == pytest.approx(direct, abs=1e-9)


def halves() -> tuple[Image, States]:
    """Left half dark (bin 0), right half bright (bin 15), and boxes: left, right, both."""
    gray = np.zeros((40, 80), np.uint8)
    gray[:, 40:] = 250
    return gray, np.concatenate([box(10, 10, 30, 30), box(50, 10, 70, 30), box(30, 10, 50, 30)])


def test_distance_and_ratio_by_hand() -> None:
    """Reference all dark: equal is 0, disjoint 1, half and half 1 - sqrt(1/2) = 0.292893. With offset 3 and
    slope 8 the logs are 3, -5 and 0.656854; tempered by a half and bounded by 2: 1.5, -2 and 0.328427."""
    gray, states = halves()
    dark = np.eye(BINS)[0]
    seen = likelihood(dark, 3.0, 8.0).observe(whole_picture(gray).view(gray))
    assert seen.distance(states) == pytest.approx([0.0, 1.0, 0.292893], abs=1e-6)
    assert seen.log_ratio(states) == pytest.approx([3.0, -5.0, 0.656854], abs=1e-5)
    tempered = HistogramLikelihood(dark, 3.0, 8.0, 0.5, 2.0).observe(whole_picture(gray).view(gray))
    assert tempered.log_ratio(states) == pytest.approx([1.5, -2.0, 0.328427], abs=1e-5)


def test_box_that_leaves_the_polygon_is_penalised() -> None:
    """A dark box that is all or 80 % inside fits; 70 % inside or outside, its distance is 1."""
    roi = make_roi([(0.25, 0.0), (1.0, 0.0), (1.0, 1.0), (0.25, 1.0)], 200, 100, 200)
    seen = likelihood(np.eye(BINS)[0], 3.0, 8.0).observe(roi.view(np.zeros(roi.shape, np.uint8)))
    leaving = np.concatenate(
        [box(20, 20, 40, 40), box(-4, 20, 16, 40), box(-6, 20, 14, 40), box(-40, 20, -20, 40)]
    )
    assert seen.distance(leaving) == pytest.approx([0.0, 0.0, 1.0, 1.0], abs=1e-12)
    assert seen.log_ratio(leaving) == pytest.approx([3.0, 3.0, -5.0, -5.0])


def test_next_picture_replaces_the_last() -> None:
    """The reused memory keeps nothing of the picture before, nor of one with another size."""
    gray, states = halves()
    dark = likelihood(np.eye(BINS)[0])
    dark.observe(whole_picture(gray).view(gray))
    mirrored = np.ascontiguousarray(gray[:, ::-1])
    assert dark.observe(whole_picture(mirrored).view(mirrored)).distance(states) == pytest.approx(
        [1.0, 0.0, 0.292893], abs=1e-6
    )
    small = np.ascontiguousarray(gray[:, :50])
    seen = dark.observe(whole_picture(small).view(small))
    assert seen.distance(states[:1]) == pytest.approx([0.0])


def test_luma_bins() -> None:
    gray = np.arange(256, dtype=np.uint8).reshape(16, 16)
    expected = np.repeat(np.arange(16), 16).reshape(16, 16)
    assert np.array_equal(bin_image(whole_picture(gray).view(gray), "luma"), expected)


@pytest.mark.parametrize(
    ("blue", "green", "red", "expected"),
    [
        (0, 0, 255, 0),  # red, hue 0
        (0, 128, 255, 1),  # orange, hue 30 degrees: 15 of 180
        (0, 255, 255, 2),  # yellow, 60 degrees
        (0, 255, 0, 4),  # green, 120 degrees
        (255, 255, 0, 6),  # cyan, 180 degrees
        (255, 0, 0, 8),  # blue, 240 degrees
        (255, 0, 255, 10),  # magenta, 300 degrees
        (40, 0, 255, 11),  # almost red again, 350 degrees
        (0, 0, 0, 12),
        (63, 63, 63, 12),
        (64, 64, 64, 13),
        (150, 150, 150, 14),
        (255, 255, 255, 15),
        (100, 110, 100, 13),  # saturation 10 / 110 * 255 = 23: too little for a hue
        (80, 110, 80, 4),  # saturation 30 / 110 * 255 = 70: green
    ],
)
def test_colour_bins(blue: int, green: int, red: int, expected: int) -> None:
    colour = np.empty((9, 9, 3), np.uint8)
    colour[:] = blue, green, red
    gray = np.zeros((9, 9), np.uint8)
    bins = bin_image(whole_picture(gray).view(gray, colour), "colour")
    assert np.all(bins == expected)


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_any_colour_has_a_bin(seed: int) -> None:
    colour = np.random.default_rng(seed).integers(0, 256, (20, 20, 3), np.uint8)
    gray = np.zeros((20, 20), np.uint8)
    assert bin_image(whole_picture(gray).view(gray, colour), "colour").max() < BINS


def test_colour_asked_of_a_gray_picture() -> None:
    gray = np.zeros((20, 20), np.uint8)
    colourful = HistogramLikelihood(EVEN, 0.0, 1.0, 1.0, np.inf, "colour")
    with pytest.raises(ValueError, match="needs colour"):
        colourful.observe(whole_picture(gray).view(gray))


def test_empty_box_has_no_histogram() -> None:
    gray = np.zeros((20, 20), np.uint8)
    seen = likelihood().observe(whole_picture(gray).view(gray))
    assert np.array_equal(histogram(seen.integral, box(30, 5, 40, 15)[0]), np.zeros(BINS))
