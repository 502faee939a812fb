"""The experiments' scenes and counts can be believed: pixels agree with the truth, and sums by hand."""

from __future__ import annotations

import numpy as np
import pytest

from docs.experiments.traffic import scene as traffic
from lumpwatch.models.trackers.jpda import associate
from tests.reproduction.paper3_jpda import simulation, system


def test_pixels_agree_with_the_truth() -> None:
    """Where a picture is not the empty road, there is a box; and every box has an object in it."""
    sequence = traffic.make_sequence(7, empty=30)
    pictures = list(sequence.pictures())
    assert len(pictures) == traffic.FRAMES
    road = np.mean(pictures[:20], axis=0)
    for frame in (60, 150, 240, 329):
        changed = np.abs(pictures[frame] - road).max(axis=2) > 30.0
        covered = np.zeros(changed.shape, bool)
        for _, (x, y, w, h), share in sequence.truth(frame):
            rows = slice(int(np.floor(y - h / 2)), int(np.ceil(y + h / 2)) + 1)
            columns = slice(int(np.floor(x - w / 2)), int(np.ceil(x + w / 2)) + 1)
            covered[rows, columns] = True
            assert share < 0.5 or changed[rows, columns].mean() > 0.4
        assert np.mean(changed & ~covered) < 1e-3


def test_the_same_seed_gives_the_same_pixels() -> None:
    one, other = (next(iter(traffic.make_sequence(3, empty=0).pictures())) for _ in range(2))
    assert np.array_equal(one, other)
    assert not np.array_equal(one, next(iter(traffic.make_sequence(4, empty=0).pictures())))


@pytest.mark.parametrize("seed", range(10))
def test_traffic_is_as_told(seed: int) -> None:
    sequence = traffic.make_sequence(seed, empty=traffic.LEARNING)
    assert sum(vehicle.wrong_way for vehicle in sequence.vehicles) == 2
    counts = [len(sequence.truth(frame)) for frame in range(traffic.FRAMES)]
    assert not any(counts[: traffic.LEARNING])
    assert max(counts) <= traffic.MOST
    for vehicle in sequence.vehicles:
        along = np.diff(vehicle.boxes[:, :2], axis=0) @ traffic.DIRECTION
        assert np.all(along < 0.0) if vehicle.wrong_way else np.all(along > 0.0)


def test_counts_by_hand() -> None:
    """One box is right, one false, one lies on an object that hardly shows; one object is missed."""
    true = np.array([[50.0, 50.0, 20.0, 20.0], [100.0, 50.0, 20.0, 20.0], [150.0, 2.0, 20.0, 4.0]])
    found = np.array([[52.0, 50.0, 20.0, 20.0], [200.0, 200.0, 10.0, 10.0], [150.0, 1.0, 10.0, 2.0]])
    counts = system.Counts()
    pairs = system.count(true, np.array([True, True, False]), found, counts)
    assert pairs == [(0, 0)]
    assert (counts.matched, counts.missed, counts.false, counts.nothing) == (1, 1, 1, 1)
    assert (counts.precision, counts.recall, counts.on_objects) == (0.5, 0.5, 0.5)


def test_score_by_hand() -> None:
    """Two of eight estimates change places halfway: neither is held, and two ids switch."""
    truth = np.zeros((simulation.STEPS + 1, simulation.TARGETS, 2))
    truth[:, :, 0] = 100.0 * np.arange(simulation.TARGETS)
    track = truth + np.array([3.0, 4.0])
    track[50:, [0, 1]] = track[50:, [1, 0]]
    score = simulation.score(simulation.Scene(truth, ()), track)
    assert score.held == 0.75
    assert score.error == pytest.approx(5.0)
    assert score.switches == 0.25


def test_global_nearest_is_the_most_probable_event() -> None:
    """Apart each target would take measurement 0; together the best event gives 1 to the second."""
    density = np.array([[0.9, 0.0], [0.8, 0.5]])
    beta = simulation.global_nearest(density, 0.9, 1e-3).beta
    assert beta.tolist() == [[0, 1, 0], [0, 0, 1]]
    assert simulation.nearest(density, 0.9, 1e-3).beta.tolist() == [[0, 1, 0], [0, 1, 0]]
    assert simulation.global_nearest(1e-9 * density, 0.9, 1e-3).beta.tolist() == [[1, 0, 0], [1, 0, 0]]
    assert associate(density, 0.9, 1e-3).beta[0, 1] > 0.9
