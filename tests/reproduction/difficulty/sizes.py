"""How large lumps are said to be, against how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumpwatch.models.evaluation import overlaps
from lumpwatch.service.offline.backtest.episodes import spans
from lumpwatch.service.offline.backtest.truth import OVERLAP
from tests.reproduction.difficulty.judge import judged
from tests.reproduction.difficulty.peers import OURS, PEERS
from tests.reproduction.difficulty.work import Task, load, truth_boxes


@dataclass(frozen=True, slots=True)
class Stated:
    """Sizes of one kind of moment."""

    true_mm: np.ndarray
    stated_mm: np.ndarray
    """Stated longest diameter (n,), NaN where none was yet."""
    low_mm: np.ndarray
    high_mm: np.ndarray

    @property
    def known(self) -> np.ndarray:
        """Where a size was stated (n,)."""
        return np.isfinite(self.stated_mm)

    @property
    def errors(self) -> np.ndarray:
        """Relative errors of the stated sizes."""
        return self.stated_mm[self.known] / self.true_mm[self.known] - 1.0

    @property
    def held(self) -> int:
        """Stated intervals that hold the truth."""
        inside = (self.low_mm <= self.true_mm) & (self.true_mm <= self.high_mm)
        return int(inside[self.known].sum())


@dataclass(frozen=True, slots=True)
class Sizes:
    """Of one style."""

    at_alarm: Stated
    """One for each announced lump: at the first frame at which the alarm stood with an estimate on it."""
    on_track: Stated
    """One for each frame before the lip with an estimate on a lump."""


def sizes(folder: Path, tasks: Sequence[Task], raise_above: float) -> Sizes:
    """Sizes on the feeds."""
    first: list[tuple[float, ...]] = []
    track: list[tuple[float, ...]] = []
    for task, one in zip(tasks, judged(folder, tasks, OURS), strict=True):
        stated = load(folder, task, OURS).sizes
        recording = one.recording
        standing = np.zeros(len(recording.times), dtype=bool)
        for raised, cleared in spans(recording.times, recording.alarming, PEERS[OURS].alarm(raise_above)):
            standing[raised:cleared] = True
        boxes, true_mm = truth_boxes(folder, task)
        for lump in one.truth.lumps:
            own = {box.frame: box for box in boxes if box.track == lump.track}
            announced = False
            for k in lump.on[recording.times[lump.on] < lump.lip_s]:
                box = own.get(int(recording.frames[k]))
                if box is None or not lump.counted:
                    continue
                chosen = _on(recording.owner, recording.boxes, int(k), (box.x, box.y, box.w, box.h))
                row = (true_mm[lump.track], *stated[chosen])
                track.append(row)
                if standing[k] and not announced:
                    announced = True
                    first.append(row)
    return Sizes(_stated(first), _stated(track))


def _on(owner: np.ndarray, boxes: np.ndarray, k: int, box: tuple[float, ...]) -> int:
    """Index of the estimate of frame k that lies best on a box."""
    there = np.flatnonzero(owner == k)
    shared = overlaps(boxes[there], np.array([box]))[:, 0]
    assert shared.max() > OVERLAP
    return int(there[shared.argmax()])


def _stated(rows: list[tuple[float, ...]]) -> Stated:
    return Stated(*np.array(rows, dtype=float).reshape(-1, 4).T)
