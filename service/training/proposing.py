"""Proposing labels: the present filter watches a recording, and its tracks become proposals.

The pieces of a lump that the filter lost and found again are linked where the later piece begins near
the place to which the earlier one was moving. Pieces that stay short are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.roi import Image
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import DetectedObject, Frame, RoiResult, whole_bgr
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior
from lumpwatch.service.training.label_proposals import Proposal, ProposedBox

LINK_S = 1.5
"""Longest gap over which pieces are linked."""
LEAST_S = 0.5
"""Shortest track that is proposed."""
BEFORE_S, AFTER_S = 2.0, 1.0
"""How long before and after a track the lump may be there as well."""
_OVERLAP = 0.2
Array = NDArray[np.float64]
_CONTEXT = 2.5
_PICTURE = 240


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A proposal with a picture of its surest moment."""

    proposal: Proposal
    picture: Image
    first_s: float
    last_s: float


@dataclass(slots=True)
class Surest:
    """Where existence was highest, whether anything was proposed there or not."""

    existence: float = 0.0
    frame: int = 0
    """From 1."""
    time_s: float = 0.0
    box: tuple[int, int, int, int] | None = None
    """x, y, w, h in pixels; None where nothing was located."""


@dataclass(slots=True)
class _Piece:
    """What the filter followed under one id."""

    boxes: list[ProposedBox]
    times: list[float]
    picture: Image
    best: float = 0.0

    def at(self, time_s: float) -> list[float]:
        """Where the box is at a time before or after, at the velocity of that end."""
        ahead = time_s >= self.times[-1]
        n = min(len(self.boxes), 8)
        pick = slice(-n, None) if ahead else slice(0, n)
        boxes, times = self.boxes[pick], self.times[pick]
        end = self.boxes[-1] if ahead else self.boxes[0]
        span = max(times[-1] - times[0], 1e-6)
        away = time_s - (self.times[-1] if ahead else self.times[0])
        centres = [(box.x + box.w / 2, box.y + box.h / 2) for box in (boxes[0], boxes[-1])]
        dx, dy = ((centres[1][k] - centres[0][k]) / span * away for k in (0, 1))
        return [end.x + dx, end.y + dy, end.w, end.h]


def suggest(
    camera: CameraConfig,
    prior: Prior | None,
    frames: Iterable[Frame],
    advance: Callable[[int], None] = lambda _: None,
    surest: Surest | None = None,
) -> list[Suggestion]:
    """Proposals for the only ROI of `camera`, in the order in which they appear. Raises LumpwatchError.

    `surest` is told where existence was highest.
    """
    roi = camera.rois[0]
    pipeline = CameraPipeline(camera, {roi.id: prior})
    pieces: dict[int, _Piece] = {}
    times: list[float] = []
    for frame in frames:
        times.append(frame.capture_s)
        results = pipeline.process(frame, frame.received_s)
        pipeline.check_fit()
        for result in results:
            if surest is not None:
                _look(surest, result, frame, times)
            for found in result.detection.counted if result.detection else ():
                _add(pieces, found, frame)
        advance(len(times))
    if len(times) < 2:
        raise LumpwatchError("the video has fewer than two frames")
    detector = pipeline.detector(roi.id)
    assert detector is not None
    corners = detector.roi.corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    linked = _linked(sorted(pieces.values(), key=lambda piece: piece.times[0]))
    lasting = [piece for piece in linked if piece.times[-1] - piece.times[0] >= LEAST_S]
    return [
        _suggestion(number, piece, np.array(times), low, high)
        for number, piece in enumerate(lasting, start=1)
    ]


def _look(surest: Surest, result: RoiResult, frame: Frame, times: list[float]) -> None:
    if result.existence <= surest.existence:
        return
    surest.existence, surest.frame, surest.time_s = result.existence, frame.seq + 1, times[-1] - times[0]
    objects = result.detection.objects if result.detection else ()
    best = max(objects, key=lambda one: one.existence, default=None)
    surest.box = None if best is None else (round(best.x), round(best.y), round(best.w), round(best.h))


def _add(pieces: dict[int, _Piece], found: DetectedObject, frame: Frame) -> None:
    box = ProposedBox(frame.seq + 1, found.x, found.y, found.w, found.h, found.existence)
    piece = pieces.setdefault(found.id, _Piece([], [], np.zeros((1, 1), np.uint8)))
    piece.boxes.append(box)
    piece.times.append(frame.capture_s)
    worth = found.existence * np.sqrt(found.w * found.h)
    if worth > piece.best:
        piece.best, piece.picture = worth, _cut(frame, box)


def _cut(frame: Frame, box: ProposedBox) -> Image:
    """The box and its surroundings, with the box drawn, as BGR."""
    picture = whole_bgr(frame)
    side = int(_CONTEXT * max(box.w, box.h, 24.0))
    left, top = int(box.x + box.w / 2 - side / 2), int(box.y + box.h / 2 - side / 2)
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + side, picture.shape[1]), min(top + side, picture.shape[0])
    if x1 - x0 < 2 or y1 - y0 < 2:
        return np.zeros((8, 8, 3), np.uint8)
    factor = _PICTURE / side
    out = np.asarray(cv2.resize(picture[y0:y1, x0:x1], None, fx=factor, fy=factor), dtype=np.uint8)
    corners = [(box.x - x0, box.y - y0), (box.x + box.w - x0, box.y + box.h - y0)]
    first, last = ((round(x * factor), round(y * factor)) for x, y in corners)
    cv2.rectangle(out, first, last, (60, 60, 235), 2, cv2.LINE_AA)
    return out


def _linked(pieces: list[_Piece]) -> list[_Piece]:
    """Pieces in the order of their beginnings -> whole tracks."""
    whole: list[_Piece] = []
    for piece in pieces:
        begin = piece.boxes[0]
        start = np.array([[begin.x, begin.y, begin.w, begin.h]])
        for earlier in whole:
            gap = piece.times[0] - earlier.times[-1]
            if 0 < gap <= LINK_S and overlaps(np.array([earlier.at(piece.times[0])]), start)[0, 0] > _OVERLAP:
                earlier.boxes += piece.boxes
                earlier.times += piece.times
                if piece.best > earlier.best:
                    earlier.best, earlier.picture = piece.best, piece.picture
                break
        else:
            whole.append(replace(piece))
    return whole


def _suggestion(number: int, piece: _Piece, times: Array, low: Array, high: Array) -> Suggestion:
    """A piece with boxes in every frame, and the rows around it; `times` are those of all frames."""
    frames = [box.frame for box in piece.boxes]
    columns = np.array([(b.x, b.y, b.w, b.h, b.existence) for b in piece.boxes]).T
    every = np.arange(frames[0], frames[-1] + 1)
    filled = np.column_stack([np.interp(every, frames, column) for column in columns])
    boxes = tuple(ProposedBox(int(f), *map(float, row)) for f, row in zip(every, filled, strict=True))
    first_s, last_s = piece.times[0], piece.times[-1]
    margin = []
    for k in np.flatnonzero((times >= first_s - BEFORE_S) & (times <= last_s + AFTER_S)):
        if frames[0] <= k + 1 <= frames[-1]:
            continue
        x, y, w, h = piece.at(float(times[k]))
        if low[0] <= x + w / 2 <= high[0] and low[1] <= y + h / 2 <= high[1]:
            margin.append(ProposedBox(int(k) + 1, x, y, w, h, 0.0))
    return Suggestion(Proposal(number, boxes, tuple(margin)), piece.picture, first_s, last_s)
