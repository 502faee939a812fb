"""The geometry of a region: with a calibrated belt it knows how large a lump at the limit is in each row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lumpwatch.models.state import Y
from lumpwatch.service.config import JdtConfig, RoiConfig
from lumpwatch.service.detection.detectors.filters import make_filter, make_profile
from lumpwatch.service.detection.region import make_region
from lumpwatch.service.detection.sizing import SHAPE_FACTOR
from tests.detection.test_sizing import HEIGHT, WIDTH, calibration, relative
from tests.models.test_plane import silhouette

POLYGON = relative([(-1000.0, 1000.0), (1000.0, 1000.0), (1000.0, 5500.0), (-1000.0, 5500.0)])


def region(**extra: Any) -> RoiConfig:
    return RoiConfig.model_validate({"id": "apron", "polygon": POLYGON, **extra})


@pytest.mark.parametrize("y_mm", [1500.0, 3000.0, 5000.0])
def test_the_limit_is_as_large_as_a_sphere_of_that_size(y_mm: float) -> None:
    roi = make_region(region(calibration=calibration()), WIDTH, HEIGHT)
    _, y, w, h = silhouette(0.0, y_mm, 600.0 / SHAPE_FACTOR)
    assert roi.limit_px is not None
    row = (y - roi.y) * roi.scale
    side = np.interp(row, np.arange(roi.shape[0]) + 0.5, roi.limit_px)
    assert side == pytest.approx(np.sqrt(w * h) * roi.scale, rel=0.03)


def test_a_filter_looks_for_lumps_around_the_limit_trained_or_not() -> None:
    """Near the camera a lump is larger, although nobody has labelled any."""
    roi = make_region(region(calibration=calibration()), WIDTH, HEIGHT)
    assert roi.limit_px is not None
    mean, _ = make_profile((0.1, 0.3), None, roi).at(np.array([0.0, roi.shape[0]]))
    assert mean[1, 2] - mean[0, 2] == pytest.approx(np.log(roi.limit_px[-1] / roi.limit_px[0]), rel=0.02)


def test_a_lump_is_first_looked_for_before_the_lip_only() -> None:
    """As far before it as a lump at the limit is large, and farther; here the lip lies within the region."""
    lip = relative([(-900.0, 4000.0), (900.0, 4000.0)])
    roi = make_region(region(calibration=calibration(lip=lip)), WIDTH, HEIGHT)
    assert roi.entry is not None
    assert roi.limit_px is not None
    assert not (roi.entry & ~roi.mask).any()
    lip_row = (lip[0][1] * HEIGHT - roi.y) * roi.scale
    last = int(np.flatnonzero(roi.entry.any(axis=1))[-1])
    assert last == pytest.approx(
        lip_row - np.interp(last, np.arange(len(roi.limit_px)), roi.limit_px), abs=2.0
    )
    assert np.array_equal(roi.entry[: last - 1], roi.mask[: last - 1])
    states, _ = make_filter(JdtConfig(), roi, None).births.draw(500, np.random.default_rng(0))
    assert states[:, Y].max() <= last + 1


def test_on_a_short_belt_lumps_may_enter_nearer_to_the_lip() -> None:
    """A limit of 4 m leaves no place that is 4 m from the lip: all of the belt before it is searched."""
    lip = relative([(-900.0, 4000.0), (900.0, 4000.0)])
    roi = make_region(region(calibration=calibration(lip=lip, limit_mm=4000.0)), WIDTH, HEIGHT)
    assert roi.entry is not None
    last = int(np.flatnonzero(roi.entry.any(axis=1))[-1])
    assert last == pytest.approx((lip[0][1] * HEIGHT - roi.y) * roi.scale, abs=1.5)


def test_a_region_of_the_fall_alone_is_searched_as_it_is() -> None:
    lip = relative([(-900.0, 1100.0), (900.0, 1100.0)])
    places = [(-900.0, 200.0), (900.0, 200.0), (900.0, 900.0), (-900.0, 900.0)]
    polygon = relative([(-1000.0, 1200.0), (1000.0, 1200.0), (1000.0, 5500.0), (-1000.0, 5500.0)])
    beyond = calibration(points=relative(places), points_mm=places, lip=lip)
    roi = make_region(region(polygon=polygon, calibration=beyond), WIDTH, HEIGHT)
    assert np.array_equal(roi.entry, roi.mask)  # type: ignore[arg-type]


def test_without_a_limit_sizes_are_what_training_saw() -> None:
    bare = make_region(region(), WIDTH, HEIGHT)
    assert (bare.limit_px, bare.entry) == (None, None)
    assert make_region(region(calibration=calibration(limit_mm=None)), WIDTH, HEIGHT).limit_px is None


def test_a_region_without_any_belt_is_refused() -> None:
    """The edges of this belt meet at row 32: above the horizon no ray meets the belt."""
    points = [
        (280 / WIDTH, 100 / HEIGHT),
        (360 / WIDTH, 100 / HEIGHT),
        (560 / WIDTH, 440 / HEIGHT),
        (80 / WIDTH, 440 / HEIGHT),
    ]
    places = [(0.0, 0.0), (1000.0, 0.0), (1000.0, 6000.0), (0.0, 6000.0)]
    sky = [(0.1, 0.0), (0.9, 0.0), (0.9, 0.05), (0.1, 0.05)]
    tilted = calibration(points=points, points_mm=places, lip=[points[3], points[2]])
    with pytest.raises(ValueError, match="nothing of the belt"):
        make_region(region(polygon=sky, calibration=tilted), WIDTH, HEIGHT)
