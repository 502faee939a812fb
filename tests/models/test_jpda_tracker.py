"""The tracker's objects: births, deaths, existence, zones, bounds, repeatability, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.trackers.jpda import Association, JpdaOptions, JpdaTracker
from tests.models.jpda_scenes import DT, NONE, PLAIN, SHAPE, Array, box, run, tracker


def test_a_target_is_born_confirmed_and_followed() -> None:
    steps = run(tracker(), lambda t: box(100.0 + 60.0 * t, 120.0 - 30.0 * t), 2.0)
    first = steps[0][0]
    assert (first.existence, first.confirmed) == (PLAIN.birth_existence, False)
    assert first.box.tolist() == [100.0, 120.0, 20.0, 20.0]
    assert [step[0].confirmed for step in steps[:5]] == [False, False, False, True, True]  # seen for 0.1 s
    last = steps[-1][0]
    t = 59 * DT
    assert last.box == pytest.approx([100.0 + 60.0 * t, 120.0 - 30.0 * t, 20.0, 20.0], abs=0.1)
    assert last.velocity == pytest.approx([60.0, -30.0], abs=0.5)
    assert last.existence > 0.99
    assert all(len(step) == 1 and step[0].id == 1 for step in steps)
    assert 0.0 < last.spread[0] < PLAIN.noise_px


def test_existence_after_a_miss_by_hand() -> None:
    """psi' = (1 - G) psi / (1 - G psi) with psi = 0.3 exp(-dt / T) and G = P_D P_G (Musicki, Evans 2004)."""
    subject = tracker(replace(PLAIN, end_below=0.0))
    subject.step(box(100, 100), DT)
    after = subject.step(NONE, DT)
    psi = 0.3 * np.exp(-DT / 30.0)
    g = 0.9 * (1.0 - np.exp(-8.0))
    assert after[0].existence == pytest.approx((1.0 - g) * psi / (1.0 - g * psi))


def test_existence_after_a_hit_by_hand() -> None:
    """Measured just where predicted: odds of a hit are P_D psi N / (lambda (1 - G psi))."""
    subject = tracker()
    subject.step(box(100, 100), DT)
    after = subject.step(box(100, 100), DT)
    psi = 0.3 * np.exp(-DT / 30.0)
    g = 0.9 * (1.0 - np.exp(-8.0))
    variance = 4.0 + (100.0 * DT) ** 2 + 40.0**2 * DT**3 / 3.0 + 4.0  # prior, speed, motion, measurement
    density = 1.0 / (2.0 * np.pi * variance)
    hit = 0.9 * psi * density / (0.5 / (240 * 360) * (1.0 - g * psi))
    expected = hit / (1.0 + hit) + (1.0 - g) * psi / (1.0 - g * psi) / (1.0 + hit)
    assert after[0].existence == pytest.approx(expected)


def test_space_and_colour_weigh_by_their_exponents() -> None:
    """With lambda (N / lambda)^a c^b in the place of N, c = exp(2 kappa d_0^2) for equal looks."""
    options = JpdaOptions()
    subject, picture = tracker(options), np.full((*SHAPE, 3), 90, np.uint8)
    subject.step(box(100, 100), DT, picture)
    after = subject.step(box(100, 100), DT, picture)
    psi = 0.3 * np.exp(-DT / 30.0)
    g = 0.9 * (1.0 - np.exp(-8.0))
    clutter = 0.5 / (240 * 360)
    variance = 4.0 + (100.0 * DT) ** 2 + 40.0**2 * DT**3 / 3.0 + 4.0
    pair = (1.0 / (2.0 * np.pi * variance) / clutter) ** 0.7 * np.exp(2.0 * 5.0 * 0.7**2) ** 0.3
    hit = 0.9 * psi * pair / (1.0 - g * psi)
    expected = hit / (1.0 + hit) + (1.0 - g) * psi / (1.0 - g * psi) / (1.0 + hit)
    assert after[0].existence == pytest.approx(expected)


def test_a_measurement_near_a_target_starts_no_other() -> None:
    """Eq. 30 with 0.75 of the mean side: 15 px around a box of 20 x 20."""
    for distance, count in ((14.0, 1), (16.0, 2)):
        subject = tracker()
        run(subject, lambda t: box(100, 100), 1.0)
        found = subject.step(np.vstack([box(100, 100), box(100 + distance, 100)]), DT)
        assert len(found) == count


@pytest.mark.parametrize("dt", [1 / 60, 1 / 30, 1 / 10])
def test_a_missed_target_ends_after_its_time(dt: float) -> None:
    """0.3 s whatever the frame rate; it is there in the last picture within that time."""
    options = replace(PLAIN, detection=0.5, end_below=0.0)
    subject = tracker(options)
    run(subject, lambda t: box(100, 100), 2.0, dt)
    alive = [len(step) for step in run(subject, lambda t: NONE, 1.0, dt)]
    assert sum(alive) * dt == pytest.approx(0.3)


def test_one_missed_picture_never_ends_a_target() -> None:
    """At two pictures a second a single miss is longer than the time, but it is one picture."""
    subject = tracker(replace(PLAIN, detection=0.5, birth_speed=5.0))
    run(subject, lambda t: box(100, 100), 5.0, 0.5)
    assert len(subject.step(NONE, 0.5)) == 1
    assert len(subject.step(NONE, 0.5)) == 0


def test_false_boxes_do_not_become_confirmed() -> None:
    """300 pictures with one false box each, anywhere."""
    rng = np.random.default_rng(0)
    subject = tracker()
    for _ in range(300):
        objects = subject.step(box(rng.uniform(0, 360), rng.uniform(0, 240)), DT)
        assert not any(one.confirmed for one in objects)
        assert len(objects) <= 5


def test_births_in_entry_zones_only() -> None:
    entry = ((0.0, 0.0), (360.0, 0.0), (360.0, 60.0), (0.0, 60.0))
    subject = tracker(replace(PLAIN, entries=[entry]))
    assert subject.step(box(100, 100), DT) == ()
    assert len(subject.step(box(100, 50), DT)) == 1


def test_a_target_missed_in_an_exit_zone_ends_at_once() -> None:
    leave = ((0.0, 150.0), (360.0, 150.0), (360.0, 240.0), (0.0, 240.0))
    for exits, left in (([leave], 0), ([], 1)):
        subject = tracker(replace(PLAIN, exits=exits))
        run(subject, lambda t: box(100, 100 + 60 * t), 1.0)
        assert len(subject.step(NONE, DT)) == left


@pytest.mark.parametrize(("start", "left"), [(180.0, 1), (200.0, 0)])
def test_a_missed_target_that_moves_out_ends_at_once(start: float, left: int) -> None:
    """At 60 px/s, 0.3 s are 18 px: after a second it is at 238 of 240, or 218."""
    subject = tracker()
    run(subject, lambda t: box(100, start - 20 + 60 * t, 10, 4), 1.0)
    assert len(subject.step(NONE, DT)) == left


def test_a_target_leaves_over_the_edge_of_the_picture() -> None:
    """Its box is cut more and more, its speed stays; once it is missed it has gone."""
    subject = tracker()

    def seen(t: float) -> Array:
        y = 180.0 + 60.0 * t
        low, high = y - 10.0, min(y + 10.0, 240.0)
        return box(100, 0.5 * (low + high), 20.0, high - low) if high - low > 3.0 else NONE

    steps = run(subject, seen, 2.0)
    # At 1.0 s the centre lies on the edge: half the box is seen.
    one = steps[30][0]
    assert one.box == pytest.approx([100.0, 240.0, 20.0, 20.0], abs=0.7)
    assert one.velocity[1] == pytest.approx(60.0, abs=2.0)
    assert steps[-1] == ()
    assert {one.id for step in steps for one in step} == {1}


def test_a_standing_target_at_the_edge_may_be_missed() -> None:
    """Its box reaches over the edge, but it does not move out."""
    subject = tracker()
    run(subject, lambda t: box(5, 100, 10, 20), 1.0)
    assert len(subject.step(NONE, DT)) == 1


def test_number_of_targets_is_bounded() -> None:
    subject = tracker(replace(PLAIN, most=5))
    grid = np.array([[30.0 * i + 20, 30.0 * j + 20, 8.0, 8.0] for i in range(11) for j in range(7)])
    for _ in range(5):
        assert len(subject.step(grid, DT)) == 5


def test_large_clusters_are_counted() -> None:
    """Fourteen targets within one another's gates, at most four are summed exactly."""
    subject = tracker(replace(PLAIN, exact=4, noise_px=10.0, birth_apart=0.1, split=False))
    grid = np.array([[100.0 + 12 * i, 100.0 + 12 * j, 8.0, 8.0] for i in range(7) for j in range(2)])
    subject.step(grid, DT)
    assert subject.approximated == 0
    subject.step(grid, DT)
    subject.step(grid, DT)
    assert subject.approximated == 2


def test_another_associator_takes_the_place() -> None:
    """One that finds nothing: the targets are missed whatever is measured."""

    def nothing(
        likelihood: Array, detection: Array, clutter: float, gate_probability: float, exact: int
    ) -> Association:
        n, m = likelihood.shape
        return Association(np.eye(1, m + 1).repeat(n, axis=0), np.zeros(n, np.bool_))

    subject = JpdaTracker(replace(PLAIN, end_below=0.0), SHAPE, nothing)
    subject.step(box(100, 100), DT)
    assert subject.step(box(100, 100), DT)[0].existence < PLAIN.birth_existence


def scene(seed: int) -> list[tuple[Array, NDArray[np.uint8]]]:
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
    frames = []
    for k in range(60):
        boxes = np.array([[30 + 40 * i + rng.normal(), 20 + 2 * k + rng.normal(), 18, 22] for i in range(6)])
        false = np.array([[rng.uniform(0, 360), rng.uniform(0, 240), 9, 9]])
        frames.append((np.vstack([boxes[rng.random(6) < 0.9], false]), picture))
    return frames


def test_the_same_input_gives_the_same_objects() -> None:
    frames = scene(3)
    results = []
    for _ in range(2):
        subject = tracker(JpdaOptions())
        results.append([subject.step(boxes, DT, picture) for boxes, picture in frames])
    for one, other in zip(*results, strict=True):
        assert [a.id for a in one] == [b.id for b in other]
        assert all(
            np.array_equal(a.box, b.box) and a.existence == b.existence
            for a, b in zip(one, other, strict=True)
        )


def test_no_picture_goes_without_colour() -> None:
    """Pictures may be left out at times."""
    subject = tracker(JpdaOptions())
    for k, (boxes, picture) in enumerate(scene(4)):
        objects = subject.step(boxes, DT, picture if k % 3 else None)
    assert sum(one.confirmed for one in objects) == 6


@pytest.mark.parametrize(
    ("boxes", "dt", "picture"),
    [
        (np.array([[np.nan, 1, 2, 2]]), DT, None),
        (np.array([[1, 1, np.inf, 2]]), DT, None),
        (np.array([[1, 1, 0, 2]]), DT, None),
        (np.array([[1, 1, 2, -2]]), DT, None),
        (np.ones((2, 3)), DT, None),
        (np.ones(4), DT, None),
        (NONE, 0.0, None),
        (NONE, -DT, None),
        (NONE, float("nan"), None),
        (NONE, float("inf"), None),
        (NONE, DT, np.zeros((10, 10, 3), np.uint8)),
        (np.ones((1, 4)), DT, np.zeros((240, 360, 3))),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(
    boxes: Array, dt: float, picture: NDArray[np.uint8] | None
) -> None:
    subject, twin = tracker(JpdaOptions()), tracker(JpdaOptions())
    for each in (subject, twin):
        each.step(box(100, 100), DT)
    with pytest.raises(ValueError, match=r"boxes|dt|picture"):
        subject.step(boxes, dt, picture)
    one, other = (each.step(box(101, 100), DT)[0] for each in (subject, twin))
    assert np.array_equal(one.box, other.box)
    assert one.existence == other.existence


def test_a_picture_without_extent_is_refused() -> None:
    with pytest.raises(ValueError, match="height"):
        JpdaTracker(PLAIN, (0, 360))


def test_an_unknown_association_is_refused() -> None:
    with pytest.raises(ValueError, match="association must be jpda_star or jpda, not 'gnn'"):
        JpdaOptions(association="gnn")  # type: ignore[arg-type]
