"""Colours, silhouettes and box sizes against brute force and hand-worked numbers."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.models.trackers.imm_pf.observation import (
    STEP,
    BoxCosts,
    ObservationOptions,
    PictureGrids,
    Reference,
    add,
    difference,
    observe,
    paint,
    reduced,
    refer,
)
from lumpwatch.models.trackers.imm_pf.size import CameraSize, LinearSize, ProfileSize, learn_linear, standing
from tests.models.helpers import box, flat_profile

Array = NDArray[np.float64]
SHAPE = (80, 120)
PLAIN = ObservationOptions(colour=1.0, motion=0.0, silhouette=0.0, foreground_only=False, core=1.0)


def scene(top: tuple[int, int, int], bottom: tuple[int, int, int]) -> NDArray[np.uint8]:
    """Gray, with a person of two colours in columns 40 to 60 and rows 20 to 60."""
    picture = np.full((*SHAPE, 3), 128, np.uint8)
    picture[20:40, 40:60] = top
    picture[40:60, 40:60] = bottom
    return picture


PERSON = box(40, 20, 60, 60)
RED, BLUE = (0, 0, 200), (200, 0, 0)


def mask_of(*boxes: Array) -> NDArray[np.uint8]:
    mask = np.zeros(SHAPE, np.uint8)
    for one in boxes:
        x, y, w, h = one[0, [X, Y, W, H]]
        mask[int(y - h / 2) : int(y + h / 2), int(x - w / 2) : int(x + w / 2)] = 255
    return mask


def seen_of(picture: NDArray[np.uint8], mask: NDArray[np.uint8] | None = None) -> PictureGrids:
    return reduced(picture, None, np.zeros(SHAPE, np.uint8) if mask is None else mask)


def nobody(seen: PictureGrids) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    return np.zeros(seen.colour.shape, np.uint8), np.zeros(seen.colour.shape, np.uint8)


def compare(seen: PictureGrids, states: Array, reference: Reference, o: ObservationOptions) -> BoxCosts:
    covered, claimed = nobody(seen)
    return observe(seen, states, reference, 0.0, o, covered=covered, claimed=claimed)


def test_the_person_itself_is_at_no_distance() -> None:
    seen = seen_of(scene(RED, BLUE))
    reference = refer(seen, PERSON[0], PLAIN)
    assert compare(seen, PERSON, reference, PLAIN).cost == pytest.approx([0.0], abs=1e-9)


def test_upper_and_lower_half_are_told_apart() -> None:
    """The same colours upside down share no bin in either half: d^2 = 1 + 1."""
    seen = seen_of(scene(RED, BLUE))
    reference = refer(seen, PERSON[0], PLAIN)
    turned = seen_of(scene(BLUE, RED))
    assert compare(turned, PERSON, reference, PLAIN).cost == pytest.approx([2.0])


def test_a_shifted_box_by_hand() -> None:
    """Ten of twenty columns are pavement: d^2 = 1 - sqrt(1/2) in each half."""
    seen = seen_of(scene(RED, BLUE))
    reference = refer(seen, PERSON[0], PLAIN)
    shifted = box(50, 20, 70, 60)
    assert compare(seen, shifted, reference, PLAIN).cost == pytest.approx([2 - np.sqrt(2)])
    # Only the foreground counts: there are no other colours in it.
    only = replace(PLAIN, foreground_only=True)
    masked = seen_of(scene(RED, BLUE), mask_of(PERSON))
    assert compare(masked, shifted, reference, only).cost == pytest.approx([0.0], abs=1e-9)


def test_histograms_by_brute_force() -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    picture = cv2.GaussianBlur(noise, (0, 0), 2.0).astype(np.uint8)
    before = np.roll(picture, 3, axis=1)
    seen = reduced(picture, before, np.zeros(SHAPE, np.uint8))
    reference = refer(seen, PERSON[0], PLAIN)
    rows, columns = slice(20 // STEP, 60 // STEP), slice(40 // STEP, 60 // STEP)
    upper = np.bincount(seen.colour[rows, columns][: 20 // STEP].ravel(), minlength=len(reference.upper))
    lower = np.bincount(seen.colour[rows, columns][20 // STEP :].ravel(), minlength=len(reference.lower))
    moved = np.bincount(seen.motion[rows, columns].ravel(), minlength=len(reference.motion))
    assert reference.upper == pytest.approx(upper / upper.sum())
    assert reference.lower == pytest.approx(lower / lower.sum())
    assert reference.motion == pytest.approx(moved / moved.sum())
    states = np.concatenate([PERSON, box(44, 24, 64, 64)])
    both = replace(PLAIN, colour=2.0, motion=3.0)
    cost = compare(seen, states, reference, both).cost
    other = refer(seen, states[1], PLAIN)
    motion = 1.0 - np.sqrt(reference.motion * other.motion).sum()
    assert cost[1] == pytest.approx(2.0 * difference(reference, other) + 3.0 * motion)


def test_motion_is_the_difference_of_consecutive_pictures() -> None:
    """Bins grow by powers of two: a step of brightness of 60 is in bin floor(log2(31)) = 4, of 0 in bin 0."""
    before = np.full((*SHAPE, 3), 100, np.uint8)
    picture = before.copy()
    picture[:, 60:] = 160
    motion = reduced(picture, before, np.zeros(SHAPE, np.uint8)).motion
    assert np.all(motion[:, : 60 // STEP] == 0)
    assert np.all(motion[:, 60 // STEP :] == 4)
    assert np.all(reduced(picture, None, np.zeros(SHAPE, np.uint8)).motion == 0)


SILHOUETTE = ObservationOptions(colour=0.0, motion=0.0, silhouette=1.0, band=0.5)


def test_silhouette_by_hand() -> None:
    """A band of 10 px around the box of 20 x 40: 40 x 60 less 20 x 40 = 1600.
    Ten to the right the box holds half of the person, and its band the other half, 400 of 1600."""
    seen = seen_of(scene(RED, BLUE), mask_of(PERSON))
    reference = refer(seen, PERSON[0], PLAIN)
    states = np.concatenate([PERSON, box(50, 20, 70, 60), box(80, 20, 100, 60)])
    found = compare(seen, states, reference, SILHOUETTE)
    assert found.inside == pytest.approx([1.0, 0.5, 0.0])
    assert found.ring == pytest.approx([0.0, 0.25, 0.0])
    assert found.cost == pytest.approx([0.0, 0.75, 1.0])


def test_covered_pixels_are_unknown() -> None:
    """The lower half is hidden by a nearer target: the box counts 1/2 + 1/2 neutral as foreground, the
    colours of the upper half count by a half, and what is usual for the rest."""
    seen = seen_of(scene(RED, BLUE), mask_of(PERSON))
    reference = refer(seen, PERSON[0], PLAIN)
    covered, claimed = nobody(seen)
    paint(covered, box(30, 40, 70, 80)[0], 1.0, 1)
    o = replace(SILHOUETTE, colour=1.0, neutral=0.3, core=1.0)
    # In red trousers; only they are hidden.
    other = refer(seen_of(scene(RED, RED)), PERSON[0], PLAIN)
    for reference_now, distance in ((reference, 1.0), (other, 1.0)):
        found = observe(seen, PERSON, reference_now, 0.4, o, covered=covered, claimed=claimed)
        assert found.visible == pytest.approx([0.5])
        assert found.inside == pytest.approx([0.65])
        # The lower half has no pixel to compare: that is a distance of 1, for half of the box.
        assert found.cost == pytest.approx([0.5 * distance + 0.5 * 0.4 + 0.35])


def test_a_hidden_box_costs_what_is_usual() -> None:
    seen = seen_of(scene(RED, BLUE), mask_of(PERSON))
    reference = refer(seen, PERSON[0], PLAIN)
    covered, claimed = nobody(seen)
    covered[:] = 1
    o = replace(SILHOUETTE, colour=5.0, neutral=0.3)
    found = observe(seen, PERSON, reference, 0.4, o, covered=covered, claimed=claimed)
    assert found.visible == pytest.approx([0.0])
    assert found.cost == pytest.approx([0.4 + 1.0 - 0.3])


def test_claimed_foreground_is_explained() -> None:
    seen = seen_of(scene(RED, BLUE), mask_of(PERSON))
    reference = refer(seen, PERSON[0], PLAIN)
    covered, claimed = nobody(seen)
    add(claimed, PERSON[0], 1.0, 1)
    for claim, inside in ((0.0, 1.0), (0.5, 0.65), (1.0, 0.3)):
        o = replace(SILHOUETTE, claim=claim, neutral=0.3)
        assert observe(
            seen, PERSON, reference, 0.0, o, covered=covered, claimed=claimed
        ).inside == pytest.approx([inside])
    add(claimed, PERSON[0], 1.0, -1)
    assert not claimed.any()


def test_boxes_beyond_the_picture() -> None:
    """Half outside: what is not there is no foreground. Far outside: nothing but bare ground."""
    seen = seen_of(scene(RED, BLUE), np.full(SHAPE, 255, np.uint8))
    reference = refer(seen, PERSON[0], PLAIN)
    states = np.concatenate([box(-10, 20, 10, 60), box(-500, -500, -480, -460), box(900, 20, 920, 60)])
    found = compare(seen, states, reference, SILHOUETTE)
    assert found.inside == pytest.approx([0.5, 0.0, 0.0])
    assert np.isfinite(found.cost).all()


def test_pictures_that_do_not_fit() -> None:
    picture = scene(RED, BLUE)
    with pytest.raises(ValueError, match="differ in size"):
        reduced(picture, None, np.zeros((10, 10), np.uint8))
    with pytest.raises(ValueError, match="differ in size"):
        reduced(picture, picture[:40], np.zeros(SHAPE, np.uint8))


@pytest.mark.parametrize("wrong", [{"colour": -1.0}, {"band": 0.0}, {"neutral": 1.5}, {"claim": -0.1}])
def test_options_that_cannot_be_meant(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must"):
        ObservationOptions(**wrong)  # type: ignore[arg-type]


def test_linear_size_is_learned() -> None:
    rows = np.array([100.0, 200.0, 300.0])
    boxes = np.column_stack([rows, rows, 0.3 * (0.25 * rows + 20.0), 0.25 * rows + 20.0])
    size = learn_linear(boxes)
    assert (size.slope, size.offset, size.aspect) == pytest.approx((0.25, 20.0, 0.3))
    states = blank(1)
    states[0, Y] = 240.0
    size.fill(states)
    assert states[0, [W, H]] == pytest.approx([24.0, 80.0])
    assert [size.knows(row) for row in (70.0, 80.0, 340.0, 350.0)] == [False, True, True, False]
    with pytest.raises(ValueError, match="two rows"):
        learn_linear(boxes[:1])


def test_standing_puts_the_feet_on_the_row() -> None:
    size = LinearSize(0.25, 20.0, 0.4)
    state = standing(size, 50.0, 300.0)
    assert state[Y] + state[H] / 2 == pytest.approx(300.0, abs=0.01)
    assert state[H] == pytest.approx(0.25 * state[Y] + 20.0)
    assert state[X] == 50.0


def test_profile_size() -> None:
    size = ProfileSize(flat_profile((0.0, 0.0, np.log(12.0), np.log(30.0)), 0.2))
    state = standing(size, 5.0, 60.0)
    assert state[[W, H, Y]] == pytest.approx([12.0, 30.0, 45.0])
    assert size.knows(-1e9)


def test_camera_size_by_projection() -> None:
    """A camera 5 up looks along y, tilted down; bodies of 1.8 x 0.6 stand at some distances."""
    tilt, focal = 0.4, 800.0
    right, down = np.array([1.0, 0.0, 0.0]), np.array([0.0, -np.sin(tilt), -np.cos(tilt)])
    ahead = np.array([0.0, np.cos(tilt), -np.sin(tilt)])
    rotation = np.stack([right, down, ahead])
    camera = np.array([[focal, 0.0, 384.0], [0.0, focal, 288.0], [0.0, 0.0, 1.0]])
    matrix = camera @ np.column_stack([rotation, -rotation @ [0.0, 0.0, 5.0]])

    def seen(x: float, y: float, z: float) -> Array:
        point = matrix @ [x, y, z, 1.0]
        return point[:2] / point[2]

    size = CameraSize(matrix, 1.8, 0.6)
    for x, y in ((0.0, 10.0), (3.0, 15.0), (-5.0, 30.0)):
        states = blank(1)
        states[0, [X, Y]] = seen(x, y, 0.9)
        size.fill(states)
        expected = seen(x, y, 0.0)[1] - seen(x, y, 1.8)[1]
        assert states[0, [W, H]] == pytest.approx([expected / 3, expected])
    assert size.knows(0.0)


def test_cameras_that_do_not_fit() -> None:
    with pytest.raises(ValueError, match="3 x 4"):
        CameraSize(np.eye(3), 1.8, 0.6)
    with pytest.raises(ValueError, match="ground plane"):
        CameraSize(np.zeros((3, 4)), 1.8, 0.6)
