"""Labels in MOTChallenge text.

One line a box: `frame,id,x,y,w,h,conf,class,visibility[,model]`. Frames count from 1, boxes are in
full-frame pixels by their top left corner. Boxes with conf 0 are to be ignored, as MOTChallenge has
it. The tenth column, when it is there and not empty, names the motion model that led to this frame.
Class -1 with a conf between 0 and 1 marks a proposal, which is no label yet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import LumpwatchError

_MOST = 1e9


class LabelError(LumpwatchError):
    """A label file cannot be used; the text names file, line and reason."""


@dataclass(frozen=True, slots=True)
class Box:
    """One labelled box."""

    frame: int
    """From 1."""
    track: int
    x: float
    y: float
    w: float
    h: float
    model: str | None
    """Motion model that led to this frame, None where it is not given."""


def read_labels(path: Path) -> tuple[Box, ...]:
    """All boxes, ordered by track and frame. Raises LabelError."""
    text = _text(path)
    boxes: dict[tuple[int, int], Box] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        box = _parse(line, f"{path}, line {number}")
        if box is None:
            continue
        if is_proposal(line):
            raise LabelError(
                f"{path}, line {number}: lump {box.track} is a proposal that nobody has accepted: look at it, "
                f"then train with --accept {box.track} (or --accept all), or put # before its lines"
            )
        if (box.track, box.frame) in boxes:
            raise LabelError(f"{path}, line {number}: track {box.track} has two boxes in frame {box.frame}")
        boxes[box.track, box.frame] = box
    if not boxes:
        raise LabelError(f"{path}: holds no labelled box")
    return tuple(boxes[key] for key in sorted(boxes))


def ignored_frames(path: Path) -> frozenset[int]:
    """Frames with a box to be ignored (conf 0): something is there that nobody vouches for. Raises LabelError."""
    frames = set()
    for line in _text(path).splitlines():
        fields = line.split(",")
        if len(fields) > 6 and not line.lstrip().startswith("#") and _number(fields[6]) == 0:
            frames.add(int(float(fields[0])))
    return frozenset(frames)


def ignored_boxes(path: Path) -> tuple[Box, ...]:
    """The boxes to be ignored (conf 0), with or without an id of their own. Raises LabelError."""
    found = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        fields = line.split(",")
        if len(fields) > 6 and not line.lstrip().startswith("#") and _number(fields[6]) == 0:
            box = _parse(",".join([*fields[:6], "1"]), f"{path}, line {number}")
            if box is not None:
                found.append(box)
    return tuple(found)


def is_proposal(line: str) -> bool:
    """Whether a line of a label file holds a box that awaits a person's word."""
    fields = [field.strip() for field in line.split(",")]
    if line.lstrip().startswith("#") or len(fields) < 8:
        return False
    confidence = _number(fields[6])
    return confidence is not None and 0 < confidence < 1 and _number(fields[7]) == -1


def _number(field: str) -> float | None:
    try:
        return float(field)
    except ValueError:
        return None


def check_frames(boxes: tuple[Box, ...], frames: int, path: Path, video: str) -> None:
    """Raises LabelError where a label names a frame that the video does not have."""
    last = max(box.frame for box in boxes)
    if last > frames:
        raise LabelError(f"{path}: labels frame {last}, but {video} has {frames} frames")


def _text(path: Path) -> str:
    try:
        return read_bounded(path).decode("utf-8-sig")
    except OSError as error:
        raise LabelError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise LabelError(f"{path}: is not text") from error


def _parse(line: str, where: str) -> Box | None:
    fields = [field.strip() for field in line.split(",")]
    if len(fields) < 6:
        raise LabelError(f"{where}: expected frame,id,x,y,w,h,…, found {len(fields)} fields")
    try:
        numbers = [float(field) for field in fields[:6]]
        confidence = float(fields[6]) if len(fields) > 6 and fields[6] else 1.0
    except ValueError as error:
        raise LabelError(f"{where}: '{line.strip()[:60]}' holds something that is not a number") from error
    frame, track, x, y, w, h = numbers
    if not all(map(math.isfinite, (*numbers, confidence))) or frame != int(frame) or track != int(track):
        raise LabelError(f"{where}: frame and id must be whole, all numbers finite")
    if max(map(abs, numbers)) > _MOST:
        raise LabelError(f"{where}: a number is beyond {_MOST:g}")
    if frame < 1:
        raise LabelError(f"{where}: frames count from 1, found {int(frame)}")
    if w <= 0 or h <= 0:
        raise LabelError(f"{where}: width and height must be positive")
    if confidence == 0:
        return None
    model = fields[9] if len(fields) > 9 and fields[9] else None
    return Box(int(frame), int(track), x, y, w, h, model)
