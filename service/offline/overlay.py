"""The overlay video: what the filter saw and thought, drawn into the picture."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from lumpwatch.models.roi import Image
from lumpwatch.models.state import Belief, H, W, X, Y
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import (
    COLOURS,
    NOT_COUNTED,
    Frame,
    RoiResult,
    VideoWriter,
    draw_lip,
    label_object,
    label_of,
    state_of,
    whole_bgr,
    write_words,
)
from lumpwatch.service.detection import CameraPipeline, Detector
from lumpwatch.service.errors import LumpwatchError

_PARTICLES = ((90, 220, 255), (255, 170, 60), (200, 120, 255), (120, 255, 120))
_TRACKS = ((60, 60, 235), (90, 200, 90), (235, 120, 50), (90, 220, 255), (200, 120, 255))
"""Of motion models where there are no particles to see; red, green and blue first, as in paper 2."""


class OverlayVideo:
    """Writes one picture a frame; a context manager. The frame rate is taken from the first two frames."""

    def __init__(self, path: Path, camera: CameraConfig) -> None:
        self._path = path
        self._camera = camera
        self._stack = ExitStack()
        self._writer: VideoWriter | None = None
        self._first: tuple[float, Image] | None = None
        self._began_s: float | None = None

    def __enter__(self) -> Self:
        """Raises LumpwatchError at once where the file cannot be written."""
        try:
            self._path.open("wb").close()
        except OSError as error:
            raise LumpwatchError(f"{self._path}: cannot be written ({error.strerror})") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is None and self._first is not None:
            self._open(fps=10.0)  # a clip of one picture
        self._stack.close()

    def write(self, frame: Frame, results: tuple[RoiResult, ...], pipeline: CameraPipeline) -> None:
        """Draw and write one frame."""
        self._began_s = frame.capture_s if self._began_s is None else self._began_s
        picture = draw(frame, results, pipeline, camera=self._camera)
        words = f"frame {frame.seq + 1}  {frame.capture_s - self._began_s:.2f} s"
        write_words(picture, words, (8, picture.shape[0] - 8), (255, 255, 255))
        picture = picture[: picture.shape[0] & ~1, : picture.shape[1] & ~1]  # the codec wants even sides
        if self._writer is not None:
            self._writer.write(picture)
        elif self._first is None:
            self._first = (frame.capture_s, picture)
        else:
            self._open(1.0 / max(frame.capture_s - self._first[0], 1e-3)).write(picture)

    def _open(self, fps: float) -> VideoWriter:
        """Start the file with the picture that waited for the frame rate."""
        assert self._first is not None
        height, width = self._first[1].shape[:2]
        writer = VideoWriter(self._path, width, height, fps)
        self._writer = self._stack.enter_context(writer)
        self._writer.write(self._first[1])
        return self._writer


def draw(
    frame: Frame,
    results: tuple[RoiResult, ...],
    pipeline: CameraPipeline,
    most_particles: int = 400,
    camera: CameraConfig | None = None,
) -> Image:
    """The frame as BGR with polygon, particles coloured by motion model, estimate and existence, and the
    lip where `camera` is given.
    """
    canvas = whole_bgr(frame)
    for roi in camera.rois if camera is not None else ():
        if roi.calibration is not None:
            first, last = ((round(x * frame.width), round(y * frame.height)) for x, y in roi.calibration.lip)
            draw_lip(canvas, (first, last))
    for row, result in enumerate(results):
        detector, place = pipeline.detector(result.roi), pipeline.geometry(result.roi)
        if place is None:
            continue
        colour = COLOURS[result.decision]
        corners = np.round(place.corners).astype(np.int32)
        cv2.polylines(canvas, [corners], isClosed=True, color=colour, thickness=2, lineType=cv2.LINE_AA)
        if detector is None:  # a mouth
            _draw_bar(canvas, row, result, colour)
            continue
        clouds = detector.clouds()
        palette = _PARTICLES if clouds else _TRACKS
        for cloud in clouds:
            if cloud.existence > 0.1:
                _draw_particles(canvas, detector, cloud, most_particles)
        for found in result.detection.objects if result.detection else ():
            low = (round(found.x), round(found.y))
            high = (round(found.x + found.w), round(found.y + found.h))
            ink = colour if found.counts else NOT_COUNTED
            cv2.rectangle(canvas, low, high, ink, 2 if found.counts else 1, cv2.LINE_AA)
            label_object(canvas, label_of(found), low, high, ink)
            if len(found.model_shares) > 1:
                _draw_shares(
                    canvas, low, high[0] - low[0], [share for _, share in found.model_shares], palette
                )
        _draw_bar(canvas, row, result, colour)
    return canvas


def _draw_particles(canvas: Image, detector: Detector, belief: Belief, most: int) -> None:
    alive = np.flatnonzero(belief.exists)[:: max(1, int(belief.exists.sum()) // most)]
    boxes = detector.roi.to_frame(belief.states[alive][:, [X, Y, W, H]])
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    for (x, y), label in zip(centres, belief.labels[alive], strict=True):
        cv2.circle(canvas, (round(x), round(y)), 1, _PARTICLES[label % len(_PARTICLES)], -1, cv2.LINE_AA)


def _draw_shares(
    canvas: Image,
    low: tuple[int, int],
    width: int,
    shares: Sequence[float],
    palette: Sequence[tuple[int, int, int]],
) -> None:
    """A bar above a box: how probable each motion model is (paper 2, Fig. 1)."""
    left = float(low[0])
    for m, share in enumerate(shares):
        right = left + share * width
        span = (round(left), low[1] - 6), (round(right), low[1] - 2)
        cv2.rectangle(canvas, *span, palette[m % len(palette)], -1)
        left = right


def _draw_bar(canvas: Image, row: int, result: RoiResult, colour: Sequence[int]) -> None:
    """Name, decision and existence of one ROI at the top left."""
    top = 8 + 30 * row
    blue, green, red = colour
    text = f"{result.roi}: {state_of(result)}  P = {result.existence:.2f}"
    write_words(canvas, text, (8, top + 20), (blue, green, red))
    width = round(240 * min(max(result.existence, 0.0), 1.0))
    cv2.rectangle(canvas, (8, top + 21), (248, top + 25), (30, 30, 30), -1)
    cv2.rectangle(canvas, (8, top + 21), (8 + width, top + 25), (blue, green, red), -1)
