"""The region of interest: mask, cut, scale and coordinates."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.roi import Roi, halved, make_roi
from tests.models.helpers import whole_picture

Array = NDArray[np.float64]
Polygon = list[tuple[float, float]]

POLYGONS: dict[str, Polygon] = {
    "rectangle": [(0.15, 0.10), (0.85, 0.10), (0.85, 0.98), (0.15, 0.98)],
    "triangle": [(0.1, 0.9), (0.5, 0.1), (0.95, 0.8)],
    "trapezium": [(0.35, 0.05), (0.65, 0.05), (0.95, 0.95), (0.05, 0.95)],
    "arrow": [(0.1, 0.1), (0.9, 0.5), (0.1, 0.9), (0.4, 0.5)],
}
polygons = pytest.mark.parametrize("polygon", list(POLYGONS.values()), ids=list(POLYGONS))


def working_corners(roi: Roi) -> Array:
    """The polygon in working pixels, where pixel (i, j) covers [i, i + 1) x [j, j + 1)."""
    return (roi.corners - (roi.x, roi.y)) * roi.scale


def inside_and_distance(corners: Array, shape: tuple[int, int]) -> tuple[NDArray[np.bool_], Array]:
    """Whether each pixel's centre is in the polygon, by crossings of a ray, and its distance to the edge."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    inside, distance = np.zeros(shape, np.bool_), np.full(shape, np.inf)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
        along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
        along = np.clip(along, 0, 1)
        distance = np.minimum(distance, np.hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0)))
    return inside, distance


@polygons
@pytest.mark.parametrize("working_size", [160, 1000])
def test_mask_is_the_polygon(polygon: Polygon, working_size: int) -> None:
    """Pixels whose centre is more than a pixel away from the edge are right without exception."""
    roi = make_roi(polygon, 800, 600, working_size)
    inside, distance = inside_and_distance(working_corners(roi), roi.shape)
    clear = distance > 1.0
    assert np.array_equal(roi.mask[clear] == 1, inside[clear])
    assert set(np.unique(roi.mask)) <= {0, 1}


@polygons
def test_mask_area(polygon: Polygon) -> None:
    """The shoelace area, up to the pixels that the edge touches: at most 0.75 on each px of edge."""
    roi = make_roi(polygon, 800, 600, 1000)
    corners = working_corners(roi)
    following = np.roll(corners, -1, axis=0)
    area = 0.5 * abs(np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]))
    edge = np.hypot(*(following - corners).T).sum()
    assert abs(int(roi.mask.sum()) - area) <= 0.75 * edge
    assert int(roi.mask.sum()) == pytest.approx(area, rel=0.02)


def test_whole_picture_is_all_inside() -> None:
    roi = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], 640, 360, 320)
    assert (roi.x, roi.y, roi.width, roi.height, roi.scale) == (0, 0, 640, 360, 0.5)
    assert roi.shape == (180, 320)
    assert roi.mask.all()


def test_bounding_box_by_hand() -> None:
    """Relative corners 0.1, 0.9 and 0.25, 0.75 of 200 x 100 px: 20 to 180 and 25 to 75. To be halved once,
    the box is widened to even numbers: 24 to 76."""
    roi = make_roi([(0.1, 0.25), (0.9, 0.25), (0.9, 0.75), (0.1, 0.75)], 200, 100, 80)
    assert (roi.x, roi.y, roi.width, roi.height) == (20, 24, 160, 52)
    assert roi.step == 2
    assert roi.scale == 0.5
    assert roi.shape == (26, 80)


@given(
    x=st.floats(0, 0.6),
    y=st.floats(0, 0.6),
    side=st.floats(0.2, 0.4),
    width=st.integers(200, 2000),
    size=st.integers(40, 400),
)
def test_box_lies_on_the_grid_of_halvings(x: float, y: float, side: float, width: int, size: int) -> None:
    """It covers the polygon, but for less than a step at the right and lower edge of the picture, and one
    more halving would make the polygon smaller than asked for."""
    polygon = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]
    height = width * 3 // 4
    roi = make_roi(polygon, width, height, size)
    assert roi.step & (roi.step - 1) == 0
    assert all(value % roi.step == 0 for value in (roi.x, roi.y, roi.width, roi.height))
    low, high = roi.corners.min(axis=0), roi.corners.max(axis=0)
    assert np.all(low >= (roi.x, roi.y))
    assert np.all(high - (roi.x + roi.width, roi.y + roi.height) < roi.step)
    assert roi.x + roi.width <= width
    assert roi.y + roi.height <= height
    assert max(roi.shape) == min(size, max(roi.width, roi.height))
    assert roi.scale * roi.step <= 1.0
    assert (high - low).max() < 2 * roi.step * size


def test_small_regions_are_not_scaled_up() -> None:
    roi = make_roi([(0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5)], 100, 100, 320)
    assert roi.scale == 1.0
    assert roi.shape == (50, 50)


def test_corners_outside_the_picture_are_cut_off() -> None:
    roi = make_roi([(-0.5, -0.5), (1.5, -0.5), (1.5, 1.5), (-0.5, 1.5)], 100, 60, 320)
    assert (roi.x, roi.y, roi.width, roi.height) == (0, 0, 100, 60)
    assert roi.mask.all()


@given(st.integers(0, 90), st.integers(0, 70), st.integers(0, 90), st.integers(0, 70))
def test_inside_is_the_integral_of_the_mask(x0: int, y0: int, x1: int, y1: int) -> None:
    roi = make_roi(POLYGONS["arrow"], 100, 80, 100)
    h, w = roi.shape
    (x0, x1), (y0, y1) = sorted((min(x0, w), min(x1, w))), sorted((min(y0, h), min(y1, h)))
    corners = roi.inside[y1, x1] - roi.inside[y0, x1] - roi.inside[y1, x0] + roi.inside[y0, x0]
    assert corners == roi.mask[y0:y1, x0:x1].sum()


lengths = st.floats(0.5, 500)
places = st.floats(-100, 2000)
some_boxes = st.lists(st.tuples(places, places, lengths, lengths), min_size=1, max_size=5)


@given(some_boxes, st.integers(16, 1500))
def test_to_frame_undoes_to_working(boxes: list[tuple[float, float, float, float]], size: int) -> None:
    roi = make_roi(POLYGONS["trapezium"], 1280, 720, size)
    full = np.array(boxes)
    assert np.allclose(roi.to_frame(roi.to_working(full)), full, atol=1e-8)
    assert np.allclose(roi.to_working(roi.to_frame(full)), full, atol=1e-8)


def test_to_working_by_hand() -> None:
    """Region at (20, 24), half size: the box 30, 45, 8, 12 has its centre at (34, 51), (14, 27) in the
    region and (7, 13.5) in the working picture, 4 x 6."""
    roi = make_roi([(0.1, 0.25), (0.9, 0.25), (0.9, 0.75), (0.1, 0.75)], 200, 100, 80)
    assert np.array_equal(roi.to_working(np.array([[30.0, 45.0, 8.0, 12.0]])), [[7.0, 13.5, 4.0, 6.0]])


def test_box_and_picture_agree() -> None:
    """A bright patch in the frame lies where `to_working` puts its box, also after scaling by a quarter."""
    frame = np.zeros((400, 600), np.uint8)
    frame[200:280, 240:360] = 255
    roi = make_roi([(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9)], 600, 400, 120)
    x, y, w, h = roi.to_working(np.array([[240.0, 200.0, 120.0, 80.0]]))[0]
    rows, columns = np.nonzero(roi.cut(frame) > 127)
    assert (columns.min(), columns.max() + 1) == pytest.approx((x - w / 2, x + w / 2), abs=0.5)
    assert (rows.min(), rows.max() + 1) == pytest.approx((y - h / 2, y + h / 2), abs=0.5)


def random_picture(*shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, shape, np.uint8)


def test_cut_without_scaling() -> None:
    picture = random_picture(100, 200)
    roi = make_roi([(0.1, 0.25), (0.9, 0.25), (0.9, 0.75), (0.1, 0.75)], 200, 100, 320)
    part = roi.cut(picture)
    assert np.array_equal(part, picture[25:75, 20:180])
    assert part.flags.c_contiguous


@pytest.mark.parametrize("channels", [(), (3,)])
def test_cut_averages_areas(channels: tuple[int, ...]) -> None:
    """At half size every working pixel is the mean of four, up to rounding."""
    picture = random_picture(100, 200, *channels)
    roi = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], 200, 100, 100)
    means = picture.astype(float).reshape(50, 2, 100, 2, *channels).mean(axis=(1, 3))
    assert np.abs(roi.cut(picture) - means).max() <= 0.5 + 1e-9


@pytest.mark.parametrize(("times", "channels"), [(1, ()), (2, ()), (4, ()), (8, ()), (4, (3,))])
def test_halved_averages_blocks(times: int, channels: tuple[int, ...]) -> None:
    """Each halving rounds once; the odd rest of 5 rows and 3 columns is left out."""
    picture = random_picture(64 + 5, 80 + 3, *channels)
    small = halved(picture, times)
    rows, columns = 69 // times, 83 // times
    blocks = picture[: rows * times, : columns * times].astype(float)
    means = blocks.reshape(rows, times, columns, times, *channels).mean(axis=(1, 3))
    assert small.shape == means.shape
    assert np.abs(small - means).max() <= 0.5 * np.log2(times) + 1e-9


@pytest.mark.parametrize("reduction", [1, 2, 4])
@pytest.mark.parametrize("offset", [(0, 0), (8, 16)])
def test_cut_is_the_same_wherever_the_halving_is_done(reduction: int, offset: tuple[int, int]) -> None:
    picture = random_picture(480, 640)
    roi = make_roi(POLYGONS["trapezium"], 640, 480, 120)
    assert roi.step == 4
    plane = halved(picture[offset[1] :, offset[0] :], reduction)
    assert np.array_equal(roi.cut(plane, offset, reduction), roi.cut(picture))


def test_plane_reduced_too_far_is_refused() -> None:
    roi = make_roi(POLYGONS["trapezium"], 640, 480, 120)
    for reduction in (8, 3):
        with pytest.raises(ValueError, match="at most 4 pixels"):
            roi.cut(random_picture(480, 640), reduction=reduction)


@settings(max_examples=30)
@given(st.integers(0, 20), st.integers(0, 24))
def test_cut_from_a_picture_that_starts_elsewhere(x: int, y: int) -> None:
    picture = random_picture(100, 200)
    roi = make_roi([(0.1, 0.25), (0.9, 0.25), (0.9, 0.75), (0.1, 0.75)], 200, 100, 80)
    assert np.array_equal(roi.cut(picture[y:, x:], (x, y)), roi.cut(picture))


@pytest.mark.parametrize(
    ("rows", "columns", "offset"),
    [
        (slice(0, 74), slice(0, 200), (0, 0)),
        (slice(0, 100), slice(0, 179), (0, 0)),
        (slice(26, 100), slice(0, 200), (0, 26)),
        (slice(0, 100), slice(21, 200), (21, 0)),
    ],
    ids=["below", "right", "above", "left"],
)
def test_picture_that_does_not_cover_the_region(rows: slice, columns: slice, offset: tuple[int, int]) -> None:
    roi = make_roi([(0.1, 0.25), (0.9, 0.25), (0.9, 0.75), (0.1, 0.75)], 200, 100, 80)
    with pytest.raises(ValueError, match="does not cover"):
        roi.cut(random_picture(100, 200)[rows, columns], offset)


@pytest.mark.parametrize(
    ("polygon", "width", "size"),
    [
        ([(0.5, 0.5), (0.53, 0.5), (0.53, 0.9)], 200, 320),  # 6 px wide
        ([(0.0, 0.0), (1.0, 0.0), (1.0, 0.02), (0.0, 0.02)], 2000, 100),  # flat once scaled
        ([(1.2, 1.2), (1.5, 1.2), (1.5, 1.5)], 200, 320),  # outside
        ([(0.3, 0.3), (0.3, 0.3), (0.3, 0.3)], 200, 320),  # a point
    ],
)
def test_regions_too_small_are_refused(polygon: Polygon, width: int, size: int) -> None:
    with pytest.raises(ValueError, match="the region is only"):
        make_roi(polygon, width, 100, size)


def test_view_carries_the_mask() -> None:
    gray, colour = random_picture(60, 80), random_picture(60, 80, 3)
    roi = whole_picture(gray)
    assert roi.view(gray).colour is None
    view = roi.view(gray, colour)
    assert view.gray is gray
    assert view.colour is colour
    assert np.array_equal(view.inside, cv2.integral(roi.mask))
