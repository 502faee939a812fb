"""What training keeps of a video: working pictures with their labels, and the flow of what moves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.motion_prior import CellVelocities, flow_vectors, learn_cells
from lumpwatch.models.learning import LabelledView
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.models.trackers.foreground import MixtureForeground
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import Frame, working_colour, working_luma
from lumpwatch.service.detection import make_region
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Box

MOST_VIEWS = 900
"""Working pictures that are kept for fitting the likelihood (a 320 x 240 one takes 75 kB)."""
_MOST_FLOW = 200_000
_LEAST_FLOW_H_S = 0.01
_CELL_H = 0.052
"""Side of a cell of the motion prior, ROI heights: 30 of 576 rows, as in paper 2."""


class TrainingError(LumpwatchError):
    """The footage does not teach what is needed; the text says what is missing."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Where a kept picture comes from."""

    clip: int
    """Index of the clip."""
    frame: int
    """From 1."""
    time_s: float
    tracks: tuple[int, ...]
    """Ids of the labelled objects in it, in the order of the view's objects."""


@dataclass(slots=True, kw_only=True)
class Footage:
    """What is kept of one or more videos."""

    roi: Roi
    views: list[LabelledView]
    moments: list[Moment]
    """One a view."""
    interval_s: float
    count: int
    width: int
    height: int
    cells: CellVelocities | None

    def only(self, pictures: Sequence[int], most: int | None = None) -> Footage:
        """The same with these of its pictures alone, evenly thinned to `most`."""
        stride = 1 if most is None else -(-len(pictures) // most) or 1
        kept = pictures[::stride]
        return replace(self, views=[self.views[k] for k in kept], moments=[self.moments[k] for k in kept])


def read_footage(
    roi: RoiConfig,
    frames: Iterable[Frame],
    boxes: Sequence[Box],
    advance: Callable[[int], None],
    *,
    clip: int = 0,
    left_out: Collection[int] = (),
    most_views: int = MOST_VIEWS,
    flow: Flow | None = None,
) -> Footage:
    """Read the video once, keeping a thinned-out set of working pictures and all capture times.

    Frames `left_out` are not kept. `flow` goes on gathering what it has of other clips.
    """
    by_frame: dict[int, list[Box]] = {}
    for box in boxes:
        by_frame.setdefault(box.frame, []).append(box)
    geometry: Roi | None = None
    views: list[LabelledView] = []
    moments: list[Moment] = []
    times: list[float] = []
    stride, size = 1, (0, 0)
    if flow is None and needs_flow(roi):
        flow = Flow()
    for frame in frames:
        if geometry is None:
            size = (frame.width, frame.height)
            try:
                geometry = make_region(roi, *size)
            except ValueError as error:
                raise TrainingError(f"roi {roi.id}: {error}") from error
        number = len(times) + 1
        if len(times) % stride == 0 and number not in left_out:
            objects, tracks = _objects(geometry, by_frame.get(number, ()))
            gray = working_luma(frame, geometry)
            colour = working_colour(frame, geometry) if roi.detector.needs_colour else None
            views.append(LabelledView(geometry.view(gray, colour), objects))
            moments.append(Moment(clip, number, frame.capture_s, tracks))
            if len(views) > most_views:
                stride *= 2
                kept = [k for k, moment in enumerate(moments) if (moment.frame - 1) % stride == 0]
                views, moments = [views[k] for k in kept], [moments[k] for k in kept]
        if flow is not None:
            colour = working_colour(frame, geometry) if roi.detector.needs_colour else None
            flow.add(working_luma(frame, geometry), frame.capture_s, colour)
        times.append(frame.capture_s)
        advance(len(times))
    if geometry is None or len(times) < 2:
        raise TrainingError("the video has fewer than two frames")
    interval = float(np.median(np.diff(times)))
    if not interval > 0:
        raise TrainingError("the video's frames carry no advancing time stamps")
    cells = None if flow is None else flow.learn(geometry.shape)
    width, height = size
    return Footage(
        roi=geometry,
        views=views,
        moments=moments,
        interval_s=interval,
        count=len(times),
        width=width,
        height=height,
        cells=cells,
    )


def needs_flow(roi: RoiConfig) -> bool:
    """Whether the region's models learn from everything that moves."""
    return any(model.kind == "motion_prior" for model in roi.detector.models)


class Flow:
    """Gathers the optical flow of everything that moves."""

    def __init__(self) -> None:
        self._last: tuple[Image, float, Image | None] | None = None
        self._foreground = MixtureForeground()
        self._positions: list[NDArray[np.float64]] = []
        self._velocities: list[NDArray[np.float64]] = []
        self._kept = 0

    def add(self, gray: Image, time_s: float, colour: Image | None = None) -> None:
        """The next working picture; with colour (h, w, 3) the flow of the foreground alone is gathered."""
        mask = None if colour is None else self._foreground.apply(colour)
        if self._last is not None and time_s > self._last[1] and self._kept < _MOST_FLOW:
            positions, velocities = flow_vectors(self._last[0], gray, time_s - self._last[1], self._last[2])
            moving = np.hypot(velocities[:, 0], velocities[:, 1]) > _LEAST_FLOW_H_S * gray.shape[0]
            self._positions.append(positions[moving])
            self._velocities.append(velocities[moving])
            self._kept += int(moving.sum())
        self._last = (gray, time_s, mask)

    def learn(self, shape: tuple[int, int]) -> CellVelocities:
        """The motion prior; raises TrainingError where nothing moved."""
        try:
            cell = _CELL_H * shape[0]
            return learn_cells(np.concatenate(self._positions), np.concatenate(self._velocities), shape, cell)
        except ValueError as error:
            raise TrainingError(f"motion prior: {error}") from error


def _objects(roi: Roi, boxes: Sequence[Box]) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """States and ids of the labelled boxes whose centre lies in the region's bounding box."""
    states = blank(len(boxes))
    if boxes:
        states[:, [X, Y, W, H]] = roi.to_working(np.array([[b.x, b.y, b.w, b.h] for b in boxes]))
    h, w = roi.shape
    inside = (states[:, X] >= 0) & (states[:, X] < w) & (states[:, Y] >= 0) & (states[:, Y] < h)
    ids = tuple(box.track for box, is_in in zip(boxes, inside, strict=True) if is_in)
    return states[inside], ids
