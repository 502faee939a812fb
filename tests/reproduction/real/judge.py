"""What a minute's states are worth, from files alone: `states.jsonl` as `lumpwatch replay` writes it, and labels.

A lump leaves when the middle of its box leaves the region of interest for the last time. It is announced when, a
second before that or earlier, the state is LUMP and an object lies on it (intersection over union above 0.3). It
counts where the video shows it leave, and two seconds before.

An alarm is a run of LUMP. It is false where at no frame of the run an object lay on a lump; where one lay on a rock
that may be taken for a lump (0.8 of the limit and more, or cut by a seam) it counts neither way.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

LEAST_WARNING_S, LEAST_SEEN_S = 1.0, 2.0
OVERLAP = 0.3
Boxes = NDArray[np.float64]
Labels = Mapping[int, Sequence[tuple[int, Boxes]]]
"""For each frame, from 1, ids and boxes (x, y, w, h)."""


@dataclass(frozen=True, slots=True)
class Said:
    """One frame: whether the alarm stands, and the boxes that are shown (n, 4)."""

    frame: int
    lump: bool
    boxes: Boxes


@dataclass(frozen=True, slots=True)
class Lump:
    """What became of a lump that counts."""

    id: int
    leaves_s: float
    warned_s: float | None
    """Seconds before it left at which it was announced first; None: never."""
    boxed: bool
    """Some object lay on it at some time, alarm or not."""
    height: float
    """Of its largest box, pixels."""

    @property
    def announced(self) -> bool:
        """In time."""
        return self.warned_s is not None and self.warned_s >= LEAST_WARNING_S - 1e-6


@dataclass(frozen=True, slots=True)
class Verdict:
    """One minute."""

    seconds: float
    lumps: tuple[Lump, ...]
    alarms: int
    false_alarms: int
    unclear_alarms: int
    standing: float
    """Share of the frames at which the alarm stood."""
    stray: float
    """Share of the alarm's frames at which no object lay on a lump or on what may be taken for one."""

    @property
    def announced(self) -> int:
        """Lumps announced in time."""
        return sum(lump.announced for lump in self.lumps)


def read_states(path: Path) -> list[Said]:
    """The lines of one region."""
    said = []
    for line in path.read_text(encoding="utf-8").splitlines():
        one = json.loads(line)
        boxes = [(o["x"], o["y"], o["w"], o["h"]) for o in one.get("objects", ())]
        said.append(Said(one["frame"], one["state"] == "LUMP", np.array(boxes, float).reshape(-1, 4)))
    return said


def read_labels(path: Path) -> dict[int, list[tuple[int, Boxes]]]:
    """MOTChallenge text; a file that is not there holds none."""
    found: dict[int, list[tuple[int, Boxes]]] = defaultdict(list)
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            fields = line.split(",")
            if len(fields) >= 6:
                found[int(fields[0])].append((int(fields[1]), np.array([float(f) for f in fields[2:6]])))
    return dict(found)


def judge(
    said: Sequence[Said],
    lumps: Labels,
    unclear: Labels,
    polygon: Sequence[Sequence[float]],
    size: tuple[int, int],
    fps: float,
) -> Verdict:
    """Judge a minute; `polygon` in shares of the picture's `size` (w, h)."""
    corners = (np.array(polygon) * size).astype(np.float32)
    last = max(one.frame for one in said)
    inside: dict[int, list[int]] = defaultdict(list)
    first: dict[int, int] = {}
    height: dict[int, float] = defaultdict(float)
    for frame in sorted(lumps):
        for lump, box in lumps[frame]:
            first.setdefault(lump, frame)
            height[lump] = max(height[lump], float(box[3]))
            if cv2.pointPolygonTest(corners, (box[0] + box[2] / 2, box[1] + box[3] / 2), False) >= 0:
                inside[lump].append(frame)
    warned: dict[int, int] = {}
    boxed: set[int] = set()
    touched: list[str] = []
    for one in said:
        on = [lump for lump, box in lumps.get(one.frame, ()) if _lies(one.boxes, box)]
        boxed.update(on)
        near = any(_lies(one.boxes, box) for _, box in unclear.get(one.frame, ()))
        touched.append("lump" if on else "unclear" if near else "nothing")
        if one.lump:
            for lump in on:
                warned.setdefault(lump, one.frame)
    found = []
    for lump, frames in sorted(inside.items()):
        leaves = frames[-1]
        if leaves >= last or (leaves - first[lump]) / fps < LEAST_SEEN_S:
            continue
        lead = (leaves - warned[lump]) / fps if lump in warned else None
        found.append(Lump(lump, round((leaves - 1) / fps, 3), lead, lump in boxed, round(height[lump], 1)))
    runs = _runs(said)
    kinds = [set(touched[a:b]) for a, b in runs]
    standing = sum(b - a for a, b in runs)
    stray = sum(touched[k] == "nothing" for a, b in runs for k in range(a, b))
    return Verdict(
        round(last / fps, 3),
        tuple(found),
        len(runs),
        sum("lump" not in kind and "unclear" not in kind for kind in kinds),
        sum("lump" not in kind and "unclear" in kind for kind in kinds),
        standing / len(said),
        stray / max(standing, 1),
    )


def _runs(said: Sequence[Said]) -> list[tuple[int, int]]:
    """First index and the one after the last of every run of LUMP."""
    runs, start = [], None
    for k, one in enumerate(said):
        if one.lump and start is None:
            start = k
        elif not one.lump and start is not None:
            runs.append((start, k))
            start = None
    return runs if start is None else [*runs, (start, len(said))]


def _lies(boxes: Boxes, box: Boxes) -> bool:
    """Whether one of the boxes lies on a box."""
    if not len(boxes):
        return False
    low = np.maximum(boxes[:, :2], box[:2])
    high = np.minimum(boxes[:, :2] + boxes[:, 2:], box[:2] + box[2:])
    both = np.prod(np.maximum(high - low, 0.0), axis=1)
    either = np.prod(boxes[:, 2:], axis=1) + box[2] * box[3] - both
    return bool((both / either > OVERLAP).any())


def judge_folder(out: Path, minute: Path) -> Verdict:
    """Judge `states.jsonl` in `out` on a minute of a site."""
    about = json.loads((minute / "about.json").read_text(encoding="utf-8"))
    site = json.loads((minute / "site.yaml").read_text(encoding="utf-8"))
    view = about if "width" in about else about["view"]
    size = view["width"], view["height"]
    return judge(
        read_states(out / "states.jsonl"),
        read_labels(minute / "gt.txt"),
        read_labels(minute / "unclear.txt"),
        site["cameras"][0]["rois"][0]["polygon"],
        size,
        about["fps"],
    )
