"""What was said, judged: curves over thresholds, the best threshold, and one cell of the matrix.

Announced and false are what the backtest takes for it: a lump is found when an alarm stands, with a
box on the lump, 1 s before its fall or earlier; an alarm is false when no lump was there at its raise, nor
came or went within the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from pathlib import Path

import numpy as np

from lumpwatch.service.offline.backtest.curve import (
    Point,
    Terms,
    VideoRecord,
    in_time,
    point_at,
    quiet_time,
    scores_at,
)
from lumpwatch.service.offline.backtest.truth import truth_of
from tests.reproduction.difficulty.peers import PEERS, polygon
from tests.reproduction.difficulty.work import Task, load, missing, truth_boxes

WANTED_PER_HOUR = 6.0
"""False alarms an hour that a threshold may cost: one in ten minutes, about what the training feeds can show."""
MOST_STANDING = 0.02
"""Share of the time without lumps for which an alarm may stand: one that never clears is raised only once."""
TERMS = Terms(least_warning_s=1.0, tolerance_s=0.5, false_alarms_per_hour=WANTED_PER_HOUR)
LEVEL = 0.05
_AT_LIMIT = 0.999
"""What is smaller than the limit is no lump here: an alarm for it is false."""


def title(key: str) -> str:
    """The method's name for people."""
    return PEERS[key].title


def done(folder: Path, tasks: Sequence[Task]) -> list[Task]:
    """The tasks that all their methods have watched."""
    return [task for task in tasks if not missing(folder, task)]


def judged(folder: Path, tasks: Sequence[Task], key: str) -> list[VideoRecord]:
    """What a method said of the feeds, with their truth; those that it need not watch are left out."""
    found = []
    for task in tasks:
        if key not in task.peers:
            continue
        recording = load(folder, task, key).recording
        boxes, true_mm = truth_boxes(folder, task)
        large = [box for box in boxes if true_mm[box.track] > _AT_LIMIT * task.spec.limit_mm]
        truth = truth_of(recording, large, polygon(task.spec.style), "fall", TERMS.least_warning_s)
        found.append(VideoRecord(task.name, recording, truth))
    return found


def curve(feeds: Sequence[VideoRecord], key: str) -> list[Point]:
    """All thresholds of a method, ascending."""
    peer = PEERS[key]
    return [point_at(feeds, peer.alarm(raise_above), TERMS) for raise_above in peer.thresholds]


def best(points: Sequence[Point]) -> Point:
    """The threshold that announces most lumps at no more than the wanted rate of false alarms.

    Among equals those with the fewest false alarms count, and of these the one in the middle: it is the
    farthest from where things change. Where no threshold keeps to the rate, the one with the fewest false
    alarms is taken, and of these the highest.
    """
    allowed = [
        point
        for point in points
        if point.false_per_hour is not None
        and point.false_per_hour <= WANTED_PER_HOUR
        and point.standing_share <= MOST_STANDING
    ]
    if not allowed:
        fewest = min(point.false_alarms for point in points)
        return [point for point in points if point.false_alarms == fewest][-1]
    most = max(point.announced for point in allowed)
    allowed = [point for point in allowed if point.announced == most]
    fewest = min(point.false_alarms for point in allowed)
    allowed = [point for point in allowed if point.false_alarms == fewest]
    return allowed[len(allowed) // 2]


@dataclass(frozen=True, slots=True)
class Cell:
    """One method on the feeds of one scene, at one threshold."""

    found: tuple[bool, ...]
    """Of each counted lump, whether it was announced in time."""
    warnings_s: tuple[float, ...]
    """Of each counted lump, 0 without any warning."""
    false_alarms: int
    """On feeds with and without lumps."""
    quiet_h: float

    @property
    def per_hour(self) -> float:
        """False alarms an hour without lumps."""
        return self.false_alarms / self.quiet_h if self.quiet_h > 0 else 0.0

    def __add__(self, other: Cell) -> Cell:
        return Cell(
            self.found + other.found,
            self.warnings_s + other.warnings_s,
            self.false_alarms + other.false_alarms,
            self.quiet_h + other.quiet_h,
        )


NOTHING = Cell((), (), 0, 0.0)


def cell(feeds: Sequence[VideoRecord], key: str, raise_above: float) -> Cell:
    """What a threshold gives on feeds."""
    scores = scores_at(feeds, PEERS[key].alarm(raise_above), TERMS)
    warned = [
        seconds
        for one, result in zip(feeds, scores, strict=True)
        for lump, seconds in zip(one.truth.lumps, result.warned_s, strict=True)
        if lump.counted
    ]
    return Cell(
        tuple(in_time(seconds, TERMS) for seconds in warned),
        tuple(seconds or 0.0 for seconds in warned),
        sum(result.count("false") for result in scores),
        sum(quiet_time(one, TERMS) for one in feeds) / 3600.0,
    )


def chance(fewer: int, more: int) -> float:
    """P that a fair coin gives `more` heads or more in fewer + more throws: the exact sign test, one-sided.

    For lumps: of those that one of two methods found only, how many each did (McNemar's test, exact). For
    false alarms on the same frames: of all, how many each raised.
    """
    n = fewer + more
    return sum(comb(n, k) for k in range(more, n + 1)) / 2**n


@dataclass(frozen=True, slots=True)
class Paired:
    """Ours against a peer on the same lumps and the same frames."""

    only_ours: int
    only_theirs: int
    """Lumps that only one of the two found."""
    our_false: int
    their_false: int

    @property
    def fewer_found(self) -> bool:
        """Whether ours found fewer lumps than chance explains."""
        return chance(self.only_ours, self.only_theirs) < LEVEL

    @property
    def more_found(self) -> bool:
        """Whether ours found more lumps than chance explains."""
        return chance(self.only_theirs, self.only_ours) < LEVEL

    @property
    def more_false(self) -> bool:
        """Whether ours raised more false alarms than chance explains."""
        return chance(self.their_false, self.our_false) < LEVEL


def paired(ours: Cell, theirs: Cell) -> Paired:
    """Compare two cells of the same feeds."""
    mine, other = np.array(ours.found, dtype=bool), np.array(theirs.found, dtype=bool)
    return Paired(
        int((mine & ~other).sum()), int((other & ~mine).sum()), ours.false_alarms, theirs.false_alarms
    )
