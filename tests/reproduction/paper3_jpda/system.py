"""The whole system on the generated traffic: foreground, regions, tracker; and what it got right."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from docs.experiments.traffic.scene import (
    DIRECTION,
    FRAMES,
    HEIGHT,
    LEARNING,
    RATE,
    WIDTH,
    Sequence,
    Vehicle,
    clipped,
)
from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.roi import Image
from lumpwatch.models.trackers.foreground import Foreground, blobs
from lumpwatch.models.trackers.jpda import JpdaOptions, JpdaTracker, OneWay
from lumpwatch.models.trackers.jpda.tracker import Associator
from lumpwatch.models.trackers.tracked import TrackedObject

Array = NDArray[np.float64]
LEAST_AREA = 40
OVERLAP = 0.5
"""Intersection over union from which a box is right."""
VISIBLE = 0.5
"""Share of an object that the picture must show before its box counts, for or against."""
SETTLING_S = 0.5
"""A track may begin so long after its object is visible."""


@dataclass
class Counts:
    """Boxes of one kind against the truth."""

    matched: int = 0
    false: int = 0
    missed: int = 0
    nothing: int = 0
    """False boxes of which less than half lies on any object."""

    @property
    def precision(self) -> float:
        return self.matched / max(self.matched + self.false, 1)

    @property
    def on_objects(self) -> float:
        """Share of boxes that lie on some object, well cut out or not: what is no background."""
        return 1.0 - self.nothing / max(self.matched + self.false, 1)

    @property
    def recall(self) -> float:
        return self.matched / max(self.matched + self.missed, 1)


@dataclass
class Outcome:
    """One sequence, or several added up."""

    regions: Counts = field(default_factory=Counts)
    tracked: Counts = field(default_factory=Counts)
    objects: int = 0
    right: int = 0
    """Objects that one track held in every frame."""
    switches: int = 0
    wrong_way: int = 0
    found: int = 0
    """Wrong-way riders that were flagged."""
    falsely: int = 0
    """Tracks that were flagged on another object, or on none."""
    foreground_s: list[float] = field(default_factory=list)
    regions_s: list[float] = field(default_factory=list)
    tracker_s: list[float] = field(default_factory=list)
    busy: list[int] = field(default_factory=list)
    """True objects in each frame."""

    def add(self, other: Outcome) -> None:
        for name in ("objects", "right", "switches", "wrong_way", "found", "falsely"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("foreground_s", "regions_s", "tracker_s", "busy"):
            getattr(self, name).extend(getattr(other, name))
        for mine, theirs in ((self.regions, other.regions), (self.tracked, other.tracked)):
            mine.matched += theirs.matched
            mine.false += theirs.false
            mine.missed += theirs.missed
            mine.nothing += theirs.nothing


OPTIONS = JpdaOptions(one_way=OneWay(DIRECTION))
"""The tracker's defaults, and the direction of this road."""
Watch = Callable[[int, Image, tuple[TrackedObject, ...]], None]


def play(
    sequence: Sequence,
    foreground: Foreground,
    options: JpdaOptions,
    associator: Associator | None = None,
    watch: Watch | None = None,
    frames: int = FRAMES,
) -> Outcome:
    """Run one sequence or its beginning; pictures of the learning time are not judged and not tracked."""
    tracker = JpdaTracker(options, (HEIGHT, WIDTH), associator)
    outcome, judge = Outcome(), _Judge()
    for frame, picture in enumerate(islice(sequence.pictures(), frames)):
        start = time.perf_counter()
        mask = foreground.apply(picture)
        masked = time.perf_counter()
        if frame < LEARNING:
            continue
        boxes = blobs(mask, LEAST_AREA)
        cut = time.perf_counter()
        objects = tracker.step(boxes, 1.0 / RATE, picture)
        done = time.perf_counter()
        outcome.foreground_s.append(masked - start)
        outcome.regions_s.append(cut - masked)
        outcome.tracker_s.append(done - cut)
        truth = sequence.truth(frame)
        outcome.busy.append(len(truth))
        judge.see(frame, truth, boxes, objects, outcome)
        if watch is not None:
            watch(frame, picture, objects)
    judge.conclude(sequence, outcome)
    return outcome


class _Judge:
    """Pairs boxes with the truth frame by frame and remembers who followed whom."""

    def __init__(self) -> None:
        self.followed: dict[int, list[tuple[int, int]]] = {}
        """Of each object, frame and track (0: none) for every frame in which it counts."""
        self.flagged: dict[int, set[int]] = {}
        """Of each flagged track, the objects that it lay on while flagged."""

    def see(
        self,
        frame: int,
        truth: list[tuple[Vehicle, Array, float]],
        boxes: Array,
        objects: tuple[TrackedObject, ...],
        outcome: Outcome,
    ) -> None:
        true = np.array([box for _, box, _ in truth]).reshape(-1, 4)
        counts = np.array([share >= VISIBLE for _, _, share in truth], dtype=bool)
        count(true, counts, boxes, outcome.regions)
        confirmed = [one for one in objects if one.confirmed]
        pairs = count(
            true, counts, clipped(np.array([o.box for o in confirmed]).reshape(-1, 4)), outcome.tracked
        )
        of_truth = {i: confirmed[j].id for i, j in pairs}
        for i, (vehicle, _, _) in enumerate(truth):
            if counts[i]:
                self.followed.setdefault(vehicle.id, []).append((frame, of_truth.get(i, 0)))
        on = {j: truth[i][0] for i, j in pairs}
        for j, one in enumerate(confirmed):
            if one.wrong_way:
                self.flagged.setdefault(one.id, set())
                if j in on:
                    self.flagged[one.id].add(on[j].id)

    def conclude(self, sequence: Sequence, outcome: Outcome) -> None:
        wrong = {v.id for v in sequence.vehicles if v.wrong_way}
        for vehicle, seen in self.followed.items():
            settled = [track for frame, track in seen if frame >= seen[0][0] + SETTLING_S * RATE]
            if not settled:  # in sight too briefly to be judged
                continue
            outcome.objects += 1
            outcome.right += settled[0] != 0 and len(set(settled)) == 1
            held = [track for track in settled if track]
            outcome.switches += sum(a != b for a, b in pairwise(held))
            if vehicle in wrong:
                outcome.wrong_way += 1
                outcome.found += any(vehicle in on for on in self.flagged.values())
        outcome.falsely += sum(not on & wrong for on in self.flagged.values())


def count(true: Array, counts: NDArray[np.bool_], found: Array, into: Counts) -> list[tuple[int, int]]:
    """Pair boxes one to one; those on objects that are hardly visible count neither way."""
    shared = overlaps(_from_corner(true), _from_corner(found))
    rows, columns = linear_sum_assignment(np.where(shared >= OVERLAP, shared, 0.0), maximize=True)
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if shared[i, j] >= OVERLAP]
    right = sum(bool(counts[i]) for i, _ in pairs)
    into.matched += right
    into.missed += int(counts.sum()) - right
    taken = {j for _, j in pairs}
    for j in range(len(found)):
        if j not in taken and _lying_on(found[j], true[~counts]) < 0.5:
            into.false += 1
            into.nothing += _lying_on(found[j], true) < 0.5
    return pairs


def _from_corner(boxes: Array) -> Array:
    return np.hstack([boxes[:, :2] - 0.5 * boxes[:, 2:], boxes[:, 2:]])


def _lying_on(box: Array, others: Array) -> float:
    """Share of a box that lies on others, what lies on two of them counted twice."""
    low = np.maximum(others[:, :2] - 0.5 * others[:, 2:], box[:2] - 0.5 * box[2:])
    high = np.minimum(others[:, :2] + 0.5 * others[:, 2:], box[:2] + 0.5 * box[2:])
    return float(np.prod(np.maximum(high - low, 0.0), axis=1).sum() / (box[2] * box[3]))
