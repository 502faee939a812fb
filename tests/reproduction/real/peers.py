"""Two simple ways to find lumps, on the same minutes: moving blobs, and contours by a threshold.

Both learn from the labelled minute how large a lump is at each row, and choose there how large a blob must be: the
size that announces most lumps less three times the false alarms. What they say is written as `lumpwatch replay` does.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from tests.reproduction.real.judge import Boxes, Said, judge, read_labels
from tests.reproduction.real.ore import rounded

PEERS = ("mog2", "contours")
_WIDTH = 320
"""Pictures are looked at this wide."""
_LEVELS = np.arange(0.4, 1.6, 0.1)
_ON, _OFF = 5, 25
"""Frames until an alarm is raised, and until it is cleared."""
Gray = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Watched:
    boxes: list[Boxes]
    """Blobs of each frame, pixels of the full picture."""
    size: tuple[int, int]
    fps: float


def watch_peer(name: str, site: Path, role: str, out: Path) -> None:
    """Watch a minute and write `states.jsonl`."""
    polygon = json.loads((site / role / "site.yaml").read_text(encoding="utf-8"))["cameras"][0]["rois"][0][
        "polygon"
    ]
    labels = read_labels(site / "train" / "gt.txt")
    profile = _profile(np.array([box for boxes in labels.values() for _, box in boxes]))
    taught = _watch(name, site / "train" / "video.mp4", polygon)
    unclear = read_labels(site / "train" / "unclear.txt")

    def worth(level: float) -> float:
        said = _said(taught, profile, level)
        found = judge(said, labels, unclear, polygon, taught.size, taught.fps)
        return found.announced - 3.0 * found.false_alarms - 10.0 * found.stray

    level = max(_LEVELS, key=worth)
    watched = _watch(name, site / role / "video.mp4", polygon)
    out.mkdir(parents=True, exist_ok=True)
    with (out / "states.jsonl").open("w", encoding="utf-8") as file:
        for one in _said(watched, profile, float(level)):
            objects = [dict(zip("xywh", map(float, box), strict=True)) for box in one.boxes]
            state = "LUMP" if one.lump else "CLEAR"
            file.write(json.dumps({"frame": one.frame, "state": state, "objects": objects}) + "\n")


def _profile(boxes: Boxes) -> tuple[float, float]:
    """Log of a lump's size as a line over its row."""
    rows = boxes[:, 1] + boxes[:, 3] / 2
    slope, base = np.polyfit(rows, 0.5 * np.log(boxes[:, 2] * boxes[:, 3]), 1)
    return float(slope), float(base)


def _said(watched: _Watched, profile: tuple[float, float], level: float) -> list[Said]:
    """The alarm over blobs of a size, in mean lumps at their row."""
    slope, base = profile
    said, seen, quiet, lump = [], 0, 0, False
    for frame, boxes in enumerate(watched.boxes, 1):
        sizes = 0.5 * np.log(np.maximum(boxes[:, 2] * boxes[:, 3], 1e-9)) - base
        ratio = np.exp(sizes - slope * (boxes[:, 1] + boxes[:, 3] / 2))
        kept = boxes[(ratio >= level) & (ratio < 2.5)]
        seen, quiet = (seen + 1, 0) if len(kept) else (0, quiet + 1)
        lump = seen >= _ON or (lump and quiet < _OFF)
        said.append(Said(frame, lump, kept))
    return said


def _watch(name: str, video: Path, polygon: Sequence[Sequence[float]]) -> _Watched:
    find = _mog2() if name == "mog2" else _contours
    boxes, size, mask, fps = [], (0, 0), None, 25.0
    for gray, full, rate in _pictures(video):
        if mask is None:
            size, fps = full, rate
            mask = np.zeros_like(gray)
            cv2.fillPoly(mask, [rounded(np.array(polygon) * gray.shape[::-1])], (255,))
        blobs = cv2.bitwise_and(find(gray), mask)
        _, _, stats, _ = cv2.connectedComponentsWithStats(blobs)
        found = stats[1:, :4][stats[1:, cv2.CC_STAT_AREA] > 30].astype(float)
        boxes.append(found * (size[0] / gray.shape[1]))
    return _Watched(boxes, size, fps)


def _pictures(video: Path) -> Iterator[tuple[Gray, tuple[int, int], float]]:
    with av.open(str(video)) as container:
        stream = container.streams.video[0]
        rate = float(stream.average_rate or 25)
        for frame in container.decode(stream):
            gray = frame.to_ndarray(format="gray")
            height = round(_WIDTH * frame.height / frame.width)
            small = cv2.resize(gray, (_WIDTH, height), interpolation=cv2.INTER_AREA)
            yield np.asarray(small, np.uint8), (frame.width, frame.height), rate


def _mog2() -> Callable[[Gray], Gray]:
    # Settings as in the matrix of difficulty: a moving belt is no still background.
    model = cv2.createBackgroundSubtractorMOG2(900, 4.0, detectShadows=False)
    open_, close = (cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k)) for k in (5, 7))

    def find(gray: Gray) -> Gray:
        mask = model.apply(cv2.GaussianBlur(gray, (0, 0), 4.0))
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, open_)
        return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, close), np.uint8)

    return find


def _contours(gray: Gray) -> Gray:
    """What is brighter or darker than its surroundings by more than is usual."""
    smooth = cv2.GaussianBlur(gray, (0, 0), 3.0).astype(np.float32)
    rest = smooth - cv2.GaussianBlur(smooth, (0, 0), 25.0)
    mask = (np.abs(rest) > 1.2 * rest.std()).astype(np.uint8) * 255
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)), np.uint8)
