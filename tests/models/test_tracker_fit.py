"""What a tracker learns: box sizes by row, noise, and the scene behind what moves."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.models.learning import fit_noise, fit_size, samples
from lumpwatch.models.learning.tracker_fit import LEAST_VELOCITY_H_S
from lumpwatch.models.learning.tracks import Track
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.models.trackers.imm_pf import learn_linear
from lumpwatch.models.trackers.scene import CoverCounts, EmptyScene, learn_scene, show

HEIGHT = 500.0


def walk(rng: np.random.Generator, noise: float, interval_s: float, n: int = 400) -> Track:
    """Constant velocity with `noise` gathered in one second, px/s; boxes grow with the row."""
    velocity = np.array([40.0, 5.0]) + np.cumsum(
        noise * np.sqrt(interval_s) * rng.standard_normal((n, 2)), axis=0
    )
    place = np.cumsum(velocity * interval_s, axis=0)
    height = 0.2 * place[:, 1] + 50.0
    boxes = np.column_stack([place, 0.4 * height, height])
    return Track(np.arange(n), boxes, np.full(n, -1))


def test_noise_of_constant_velocity_is_found() -> None:
    rng = np.random.default_rng(1)
    tracks = [walk(rng, 60.0, 0.1) for _ in range(4)]
    steps = samples(tracks, 0.1, 0)
    assert fit_noise(steps, HEIGHT).velocity * HEIGHT == pytest.approx(60.0, rel=0.1)
    still = samples([walk(rng, 0.0, 0.1)], 0.1, 0)
    assert fit_noise(still, HEIGHT).velocity == LEAST_VELOCITY_H_S


def test_sizes_by_row_are_in_roi_heights() -> None:
    size = fit_size(samples([walk(np.random.default_rng(2), 10.0, 0.1)], 0.1, 0), HEIGHT)
    assert size is not None
    assert (size.slope, size.offset * HEIGHT, size.aspect) == pytest.approx((0.2, 50.0, 0.4), rel=1e-3)


def test_bent_bodies_do_not_tilt_the_line() -> None:
    rng = np.random.default_rng(3)
    rows = rng.uniform(100.0, 400.0, 200)
    boxes = np.column_stack([rows, rows, 0.1 * rows + 8.0, 0.25 * rows + 20.0])
    boxes[rows > 300.0, 3] *= np.where(rng.random((rows > 300.0).sum()) < 0.3, 0.4, 1.0)
    size = learn_linear(boxes)
    assert (size.slope, size.offset) == pytest.approx((0.25, 20.0), abs=0.5)
    plain = np.polyfit(boxes[:, 1], boxes[:, 3], 1)
    assert abs(plain[0] - 0.25) > 0.03  # what least squares would have said


def test_a_known_scene_leaves_no_hole_where_somebody_stood() -> None:
    """Somebody stands in the first pictures and goes: the place is background at once."""
    rng = np.random.default_rng(4)
    ground = rng.uniform(60.0, 180.0, (60, 80, 3))

    def picture(left: int | None) -> np.ndarray:
        shown = ground.copy()
        if left is not None:
            shown[20:50, left : left + 10] = 240.0
        return np.clip(shown + rng.normal(0.0, 3.0, shown.shape), 0, 255).astype(np.uint8)

    scene = learn_scene([picture(6 * k) for k in range(11)])
    assert np.abs(scene.picture - ground).mean() < 3.0
    share = {}
    for known in (False, True):
        model = MixtureForeground()
        if known:
            show(scene, model, np.random.default_rng(0))
        for _ in range(30):
            there = model.apply(picture(40))
        gone = model.apply(picture(None))
        share[known] = (there[20:50, 40:50] > 0).mean(), (gone[20:50, 40:50] > 0).mean()
    assert share[True][0] > 0.9
    assert share[True][1] < 0.1
    assert share[False][0] < 0.1  # taken for background
    assert share[False][1] > 0.7  # and its absence for an object


def test_another_light_is_another_scene() -> None:
    scene = learn_scene([np.full((20, 20, 3), 120, np.uint8)])
    assert scene.is_of(np.full((20, 20, 3), 130, np.uint8))
    assert not scene.is_of(np.full((20, 20, 3), 200, np.uint8))
    with pytest.raises(ValueError, match="no pictures"):
        learn_scene([])


def test_who_stands_for_most_of_the_clip_is_no_scene_where_the_labels_say_so() -> None:
    ground, stands = np.full((20, 30, 3), 120, np.uint8), np.full((20, 30, 3), 120, np.uint8)
    stands[5:15, 10:15] = 30
    there = np.zeros((20, 30), np.uint8)
    there[4:16, 9:16] = 1
    pictures, masks = [stands] * 7 + [ground] * 3, [there] * 7 + [np.zeros_like(there)] * 3
    assert (learn_scene(pictures).picture[5:15, 10:15] == 30).all()
    told = learn_scene(pictures, masks)
    assert (told.picture == 120).all()
    assert (told.spread == 0).all()
    # Never seen empty often enough: what was there most is all that is known.
    assert (learn_scene(pictures[:9], masks[:9]).picture[5:15, 10:15] == 30).all()
    with pytest.raises(ValueError, match="1 masks for 10 pictures"):
        learn_scene(pictures, masks[:1])


def test_a_post_before_everybody_is_cover() -> None:
    """People pass behind a post, which hides them from column 20 to 23; where few passed nothing is said."""
    counts = CoverCounts((40, 60))
    assert counts.cover() is None
    for x in range(5, 40):
        mask = np.zeros((40, 60), np.uint8)
        mask[10:30, max(x - 4, 0) : x + 5] = 255
        mask[:, 20:24] = 0
        counts.add(mask, np.array([[x, 20.0, 10.0, 22.0]]))
    cover = counts.cover()
    assert cover is not None
    rows, columns = np.nonzero(cover)
    assert set(columns.tolist()) == {20, 21, 22, 23}
    assert (rows.min(), rows.max()) == (11, 28)
    scene = EmptyScene(np.zeros((40, 60, 3), np.uint8), np.zeros((40, 60, 3), np.uint8), cover)
    half = scene.sized((20, 30))
    assert half.cover is not None
    assert half.cover[:, 10:12].any()
    assert not half.cover[:, :10].any()
