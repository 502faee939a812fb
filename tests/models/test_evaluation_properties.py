"""The evaluation metrics on random tracks: brute force, TrackEval, and what must not change a score."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.models.evaluation import (
    METRICS,
    ClearMot,
    Scores,
    Tracks,
    clear_mot,
    evaluate,
    pair,
    tracks_of,
)
from tests.models import evaluation_oracle as oracle

TINY = 1e-12  # what summing may round away
seeds = st.integers(0, 2**32 - 1)


def random_rows(
    rng: np.random.Generator, objects: int, frames: int
) -> tuple[list[oracle.Row], list[oracle.Row]]:
    """A result and its truth: objects that cross each other, followed by noisy tracks that miss frames, change
    their ids and are joined by false ones. Neither is empty.
    """
    start, velocity = rng.uniform(0, 40, (objects, 2)), rng.uniform(-4, 4, (objects, 2))
    size = rng.uniform(12, 25, (objects, 2))
    truth: list[oracle.Row] = [(0, 0, 5.0, 5.0, 20.0, 20.0)]
    result: list[oracle.Row] = [(0, 0, *(5 + rng.normal(0, 2, 2)), 20.0, 20.0)]
    names = rng.permutation(10)[:objects] + 1
    for t in range(1, frames):
        if rng.random() < 0.15:
            names = rng.permutation(10)[:objects] + 1
        for k in range(objects):
            x, y = start[k] + velocity[k] * t
            w, h = size[k]
            if rng.random() < 0.7:
                truth.append((t, k, x, y, w, h))
            if rng.random() < 0.7:
                dx, dy = rng.normal(0, 3, 2)
                dw, dh = np.exp(rng.normal(0, 0.1, 2))
                result.append((t, int(names[k]), x + dx, y + dy, w * dw, h * dh))
        if rng.random() < 0.2:
            result.append((t, 11, *rng.uniform(0, 40, 2), 15.0, 15.0))
    return result, truth


def as_tracks(rows: list[oracle.Row]) -> Tracks:
    table = np.array(rows)
    return tracks_of(table[:, 0], table[:, 1], table[:, 2:])


def assert_same(a: Scores, b: Scores) -> None:
    assert asdict(a) == pytest.approx(asdict(b), rel=1e-9, nan_ok=True)


# Brute force


@given(seeds, st.integers(1, 3), st.integers(1, 6), st.floats(0.05, 0.95))
@settings(max_examples=60, deadline=None)
def test_sfda_ata_and_idf1_are_those_of_brute_force(
    seed: int, objects: int, frames: int, threshold: float
) -> None:
    rng = np.random.default_rng(seed)
    result, truth = random_rows(rng, objects, frames)
    # At most six tracks, so that all assignments can be tried.
    result = [
        (row[0], row[1] % 6, *row[2:]) for row in {(row[0], row[1] % 6): row for row in result}.values()
    ]
    scores = evaluate(as_tracks(result), as_tracks(truth), threshold)
    assert scores.sfda == pytest.approx(oracle.sfda(result, truth), abs=1e-9)
    assert scores.ata == pytest.approx(oracle.ata(result, truth, None), abs=1e-9)
    assert scores.ata_relaxed == pytest.approx(oracle.ata(result, truth, threshold), abs=1e-9)
    assert scores.idf1 == pytest.approx(oracle.idf1(result, truth, threshold), abs=1e-9)


# TrackEval


def trackeval_data(result: list[oracle.Row], truth: list[oracle.Row]) -> dict[str, object]:
    """What TrackEval's metric classes take, made without `lumpwatch.models.evaluation`."""
    truth_ids = {name: k for k, name in enumerate(sorted({row[1] for row in truth}))}
    result_ids = {name: k for k, name in enumerate(sorted({row[1] for row in result}))}
    frames = sorted({row[0] for row in result + truth})
    by_frame = [(oracle.at(truth, t), oracle.at(result, t)) for t in frames]
    return {
        "num_timesteps": len(frames),
        "num_gt_ids": len(truth_ids),
        "num_tracker_ids": len(result_ids),
        "num_gt_dets": len(truth),
        "num_tracker_dets": len(result),
        "gt_ids": [np.array([truth_ids[row[1]] for row in g], int) for g, _ in by_frame],
        "tracker_ids": [np.array([result_ids[row[1]] for row in d], int) for _, d in by_frame],
        "similarity_scores": [
            np.array([[oracle.overlap(a, b) for b in d] for a in g]).reshape(len(g), len(d))
            for g, d in by_frame
        ],
    }


@pytest.fixture(scope="module")
def trackeval():  # type: ignore[no-untyped-def]
    """TrackEval's metric classes. Its packages bring a second OpenCV: it is installed without them."""
    reason = "TrackEval is not installed: pip install --no-deps trackeval"
    return pytest.importorskip("trackeval.metrics", reason=reason)


@pytest.mark.parametrize("seed", range(40))
def test_vace_and_identity_are_those_of_trackeval(trackeval, seed: int) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    result, truth = random_rows(rng, int(rng.integers(1, 9)), int(rng.integers(2, 60)))
    data = trackeval_data(result, truth)
    vace = trackeval.VACE().eval_sequence(data)
    identity = trackeval.Identity({"PRINT_CONFIG": False}).eval_sequence(data)
    scores = evaluate(as_tracks(result), as_tracks(truth))
    assert scores.sfda == pytest.approx(vace["SFDA"], abs=1e-9)
    assert scores.ata_relaxed == pytest.approx(vace["ATA"], abs=1e-9)
    assert scores.idf1 == pytest.approx(identity["IDF1"], abs=1e-9)


def clear_of_trackeval(  # type: ignore[no-untyped-def]
    trackeval, result: list[oracle.Row], truth: list[oracle.Row], threshold: float
) -> dict[str, float]:
    metric = trackeval.CLEAR({"PRINT_CONFIG": False, "THRESHOLD": threshold})
    return metric.eval_sequence(trackeval_data(result, truth))


def assert_counts(counted: ClearMot, theirs: dict[str, float]) -> None:
    assert counted.matches == theirs["CLR_TP"]
    assert counted.misses == theirs["CLR_FN"]
    assert counted.false_positives == theirs["CLR_FP"]
    assert counted.id_switches == theirs["IDSW"]
    assert counted.mota == pytest.approx(theirs["MOTA"], abs=1e-9)
    assert counted.motp == pytest.approx(theirs["MOTP"], abs=1e-9)
    assert counted.precision == pytest.approx(theirs["CLR_Pr"], abs=1e-9)
    assert counted.recall == pytest.approx(theirs["CLR_Re"], abs=1e-9)


@pytest.mark.parametrize("threshold", [0.3, 0.5])
@pytest.mark.parametrize("seed", range(40))
def test_clear_mot_is_that_of_trackeval(trackeval, seed: int, threshold: float) -> None:  # type: ignore[no-untyped-def]
    """From frame to frame, as TrackEval keeps correspondences. It passes over frames without true or found
    boxes, so an object far away that is always there, and a box beside it, keep every frame filled.
    """
    rng = np.random.default_rng(seed)
    frames = int(rng.integers(2, 60))
    result, truth = random_rows(rng, int(rng.integers(1, 9)), frames)
    truth += [(t, 20, 1000.0, 0.0, 9.0, 9.0) for t in range(frames)]
    result += [(t, 21, 2000.0, 0.0, 9.0, 9.0) for t in range(frames)]
    theirs = clear_of_trackeval(trackeval, result, truth, threshold)
    counted = clear_mot(pair(as_tracks(result), as_tracks(truth)), threshold, across_gaps=False)
    assert_counts(counted, theirs)


@pytest.mark.parametrize("seed", range(40))
def test_without_gaps_the_memory_makes_no_difference(trackeval, seed: int) -> None:  # type: ignore[no-untyped-def]
    """Objects that are always found, by tracks that change their ids: our default is TrackEval's CLEAR MOT,
    fragmentations too."""
    rng = np.random.default_rng(seed)
    frames = int(rng.integers(2, 40))
    lanes = 60.0 * np.arange(int(rng.integers(1, 7)))
    names = rng.permutation(len(lanes))
    result: list[oracle.Row] = []
    truth: list[oracle.Row] = []
    for t in range(frames):
        if rng.random() < 0.3:
            names = rng.permutation(len(lanes) + 2)
        for k, lane in enumerate(lanes):
            truth.append((t, k, 3.0 * t, lane, 30.0, 30.0))
            result.append((t, int(names[k]), 3.0 * t + rng.uniform(-5, 5), lane, 30.0, 30.0))
    counted = clear_mot(pair(as_tracks(result), as_tracks(truth)), 0.5)
    theirs = clear_of_trackeval(trackeval, result, truth, 0.5)
    assert_counts(counted, theirs)
    assert counted.fragmentations == theirs["Frag"] == 0


# What must not change a score


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_a_perfect_result(seed: int) -> None:
    """Boxes of any place and size, under other ids: every accuracy is exactly 1, every error 0."""
    rng = np.random.default_rng(seed)
    _, rows = random_rows(rng, 4, 12)
    truth = as_tracks(rows)
    scores = evaluate(tracks_of(truth.frames, 1000 - truth.ids, truth.boxes), truth, threshold=1.0)
    for metric in METRICS:
        assert getattr(scores, metric.field) == (1.0 if metric.better == "larger" else 0), metric.name


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_names_order_scale_and_place_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    result, truth = (as_tracks(rows) for rows in random_rows(rng, 5, 25))

    def renamed(tracks: Tracks) -> Tracks:
        names = rng.choice(10_000, 12, replace=False) - 5_000
        return tracks_of(tracks.frames, names[tracks.ids], tracks.boxes)

    def shuffled(tracks: Tracks) -> Tracks:
        order = rng.permutation(len(tracks.frames))
        return tracks_of(tracks.frames[order], tracks.ids[order], tracks.boxes[order])

    def enlarged(tracks: Tracks) -> Tracks:
        boxes = 3.7 * tracks.boxes + np.array([200.0, -80.0, 0.0, 0.0])
        return tracks_of(tracks.frames * 5 - 7, tracks.ids, boxes)

    scores = evaluate(result, truth)
    assert_same(evaluate(renamed(result), renamed(truth)), scores)
    assert_same(evaluate(shuffled(result), shuffled(truth)), scores)
    assert_same(evaluate(enlarged(result), enlarged(truth)), scores)


@given(seeds, st.floats(0.0, 1.0))
@settings(max_examples=40, deadline=None)
def test_bounds_and_sums(seed: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    result, truth = (as_tracks(rows) for rows in random_rows(rng, 4, 15))
    scores = evaluate(result, truth, threshold)
    for name in ("sfda", "ata", "ata_relaxed", "n_modp", "idf1", "precision", "recall"):
        assert 0.0 <= getattr(scores, name) <= 1.0 + TINY
    assert scores.mota <= 1.0
    assert scores.n_moda <= 1.0
    assert math.isnan(scores.motp) if scores.matches == 0 else threshold - TINY <= scores.motp <= 1.0 + TINY
    assert scores.matches + scores.misses == scores.truth_boxes == len(truth.boxes)
    assert scores.matches + scores.false_positives == scores.result_boxes == len(result.boxes)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_sfda_and_ata_are_the_same_in_both_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    result, truth = (as_tracks(rows) for rows in random_rows(rng, 4, 15))
    one, other = evaluate(result, truth), evaluate(truth, result)
    assert other.sfda == pytest.approx(one.sfda)
    assert other.ata == pytest.approx(one.ata)
    assert other.idf1 == pytest.approx(one.idf1)
