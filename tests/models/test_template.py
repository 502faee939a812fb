"""The template's contrasts against plain NumPy, and what lies outside the polygon."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.likelihood.lump import FEATURES, MEASURES, neutral
from lumpwatch.models.likelihood.sums import COARSE, REACH
from lumpwatch.models.likelihood.template import CELLS, CHANNELS, COLUMNS, NAMES, SPAN
from lumpwatch.models.roi import Image, Roi, make_roi
from tests.models.helpers import (
    box,
    boxes,
    gradients,
    inside_share_of_noise,
    patches_on_noise,
    whole_picture,
)

Array = NDArray[np.float64]
NOISE = 2.0


def template_of(gray: Image, roi: Roi, state: Array) -> Array:
    """The contrasts (rows, columns, channels) of a box."""
    features, valid = neutral().observe(roi.view(gray)).features(state)
    assert valid.all()
    return features[0, len(MEASURES) :].reshape(CELLS, COLUMNS, len(CHANNELS))


def brute_template(gray: Image, x: int, y: int, w: int, h: int) -> Array:
    """The same from pixels, in a picture without a polygon; cells of w and h that are multiples of 25 are whole."""
    light = gray.astype(float)
    dx, dy = gradients(light, 1)
    rough = dx + dy
    # As the module stores it: the sum over 7 x 7 pixels, its difference in units of eight.
    padded = np.pad(light, COARSE // 2, mode="reflect")
    smooth = np.lib.stride_tricks.sliding_window_view(padded, (COARSE, COARSE)).sum(axis=(2, 3))
    coarse = np.floor(sum(gradients(smooth, REACH)) / 8) * 8 / COARSE**2
    rows, columns = np.mgrid[: gray.shape[0], : gray.shape[1]]

    def within(x0: float, x1: float, y0: float, y1: float) -> NDArray[np.bool_]:
        a, b, c, d = (np.floor(edge + 0.5) for edge in (x0, x1, y0, y1))
        return (columns >= a) & (columns < b) & (rows >= c) & (rows < d)

    around = within(x - 0.75 * w, x + 0.75 * w, y - 0.75 * h, y + 0.75 * h)
    spread = light[around].std() + NOISE

    def contrast(a: float, b: float) -> float:
        return (a - b) / (a + b + 2 * NOISE)

    def lines(centre: float, size: float) -> Array:
        return centre + (np.arange(CELLS + 1) / CELLS - 0.5) * SPAN * size

    across, down = lines(x, w), lines(y, h)
    cells = np.full((CELLS, CELLS, len(CHANNELS)), np.nan)
    for r in range(CELLS):
        for c in range(CELLS):
            cell = within(across[c], across[c + 1], down[r], down[r + 1])
            if cell.any():
                cells[r, c] = [
                    (light[cell].mean() - light[around].mean()) / spread,
                    contrast(rough[cell].mean(), rough[around].mean()),
                    contrast(coarse[cell].mean(), coarse[around].mean()),
                    contrast(dx[cell].mean(), dy[cell].mean()),
                ]
    both = np.stack([cells[:, :COLUMNS], cells[:, ::-1][:, :COLUMNS]])
    known = np.isfinite(both)
    return np.where(known, both, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)


@settings(max_examples=40, deadline=None)
@given(patches_on_noise(), st.integers(15, 105), st.integers(15, 75), *[st.sampled_from([25, 50])] * 2)
def test_contrasts_against_brute_force(gray: Image, x: int, y: int, w: int, h: int) -> None:
    """Boxes anywhere in the picture, cells that lie outside it included."""
    if inside_share_of_noise(x, y, w, h) >= 0.76:
        found = template_of(gray, whole_picture(gray), boxes(1, x, y, w, h))
        assert found == pytest.approx(brute_template(gray, x, y, w, h), abs=1e-6)


def test_names_go_with_the_numbers() -> None:
    assert len(NAMES) == CELLS * COLUMNS * len(CHANNELS)
    assert NAMES[0] == "brightness 00"
    assert NAMES[-1] == "upright_edges 42"
    assert (*MEASURES, *NAMES) == FEATURES


def test_a_mirrored_picture_looks_the_same() -> None:
    gray = np.random.default_rng(3).integers(0, 255, (90, 120)).astype(np.uint8)
    roi = whole_picture(gray)
    one = template_of(gray, roi, boxes(1, 60.0, 45.0, 25.0, 25.0))
    other = template_of(np.ascontiguousarray(gray[:, ::-1]), roi, boxes(1, 60.0, 45.0, 25.0, 25.0))
    assert one == pytest.approx(other, abs=1e-9)


def test_channels_tell_what_they_are_named_after() -> None:
    """A smooth bright square on rough ground: its outline lies in the cells next to the outermost."""
    rng = np.random.default_rng(0)
    gray = rng.integers(60, 141, (160, 160)).astype(np.uint8)
    gray[55:105, 55:105] = 200
    cells = template_of(gray, whole_picture(gray), box(55, 55, 105, 105))
    bright, rough, coarse, upright = (cells[..., k] for k in range(4))
    middle, side, top = (2, 2), (2, 0), (0, 2)
    assert bright[middle] > 0 > bright[side]
    assert rough[middle] < -0.8
    assert rough[top] > 0.2
    assert coarse[middle] < -0.8
    assert upright[2, 0] > 0.1  # the left and right edges run upright
    assert upright[0, 2] < -0.1  # those above and below do not


def tilted(width: int, height: int) -> Roi:
    """A region with slanted sides."""
    return make_roi([(0.3, 0.0), (0.7, 0.0), (1.0, 1.0), (0.0, 1.0)], width, height, max(width, height))


def test_nothing_outside_the_polygon_counts() -> None:
    """A bright, striped wall beside the belt changes no feature of any box."""
    rng = np.random.default_rng(4)
    gray = rng.integers(60, 141, (120, 160)).astype(np.uint8)
    roi = tilted(160, 120)
    assert roi.shape == gray.shape
    wall = gray.copy()
    wall[roi.mask == 0] = np.where(np.arange(160) % 6 < 3, 255, 0)[None, :].repeat(120, axis=0)[roi.mask == 0]
    model = neutral()
    states = boxes(300, 0.0, 0.0, 30.0, 24.0)
    states[:, 0], states[:, 1] = rng.uniform(0, 160, 300), rng.uniform(0, 120, 300)
    plain, valid = model.observe(roi.view(gray)).features(states)
    walled, still_valid = model.observe(roi.view(wall)).features(states)
    assert valid.sum() > 50
    assert np.array_equal(valid, still_valid)
    assert np.array_equal(plain, walled)


def test_the_region_may_change_from_picture_to_picture() -> None:
    """One likelihood asked about two regions: the mask of the last does not stay."""
    gray = np.random.default_rng(5).integers(0, 255, (120, 160)).astype(np.uint8)
    model = neutral()
    state = box(60, 40, 100, 80)
    first = model.observe(tilted(160, 120).view(gray)).features(state)[0].copy()
    model.observe(whole_picture(gray).view(gray))
    assert np.array_equal(model.observe(tilted(160, 120).view(gray)).features(state)[0], first)


def test_sums_of_a_large_bright_box_do_not_overflow() -> None:
    """Stripes of black and white over 600 x 600 pixels: the largest gradients there are."""
    gray = np.where(np.arange(1000)[None, :] // 4 % 2 == 0, 255, 0).astype(np.uint8).repeat(1000, axis=0)
    gray = np.ascontiguousarray(gray)
    found = template_of(gray, whole_picture(gray), boxes(1, 500.0, 500.0, 600.0, 600.0))
    assert found == pytest.approx(brute_template(gray, 500, 500, 600, 600), abs=1e-6)
