"""One configuration on one video: what the filter finds in each frame, before any threshold.

Tasks are independent of each other, and all that they need travels with them: any executor in the
shape of `concurrent.futures` can do them, a pool on this machine or a cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import Frame
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Setup:
    """One configuration under test."""

    name: str
    camera: CameraConfig
    """The camera with the one ROI under test."""
    prior: Prior | None

    @property
    def roi(self) -> RoiConfig:
        """The ROI under test."""
        return self.camera.rois[0]


@dataclass(frozen=True, slots=True)
class Task:
    """A configuration and a video."""

    setup: Setup
    video: Path


@dataclass(frozen=True, slots=True)
class Recording:
    """What a filter found in the n frames of a video that it judged."""

    frames: Indices
    """Number of each frame (n,), from 1."""
    times: Array
    """Seconds from the first frame of the video (n,)."""
    alarming: Array
    """What the alarm judges (n,): existence or, on a calibrated belt, P(a lump above the limit is there)."""
    owner: Indices
    """Index into the n frames of each of the m estimates (m,), ascending."""
    boxes: Array
    """x, y, w, h of the estimates in full-frame pixels (m, 4)."""
    width: int
    height: int
    """Size of the pictures."""
    length: int
    """Frames of the video."""
    prior: int
    """Version of the prior that was used, 0 for the stated defaults."""

    @property
    def intervals(self) -> Array:
        """Seconds that each frame stands for (n,): to the next; the last as long as they do in the middle."""
        steps = np.diff(self.times)
        return np.append(steps, np.median(steps) if len(steps) else 0.0)


@dataclass(frozen=True, slots=True)
class Failure:
    """A video that could not be used. Errors travel as text: not every exception survives a process."""

    reason: str


def record(task: Task) -> Recording | Failure:
    """Do one task."""
    try:
        frames, _ = read_frames(task.setup.camera, task.video)
        with closing(frames):
            return record_frames(task.setup, frames, task.video)
    except LumpwatchError as error:
        return Failure(str(error))


def record_frames(setup: Setup, frames: Iterator[Frame], video: Path) -> Recording:
    """Run the pipeline over frames. Raises LumpwatchError where no frame could be judged."""
    pipeline = CameraPipeline(setup.camera, {setup.roi.id: setup.prior})
    start_s, size, length = 0.0, (0, 0), 0
    decided: list[tuple[int, float, float]] = []
    owner: list[int] = []
    boxes: list[tuple[float, float, float, float]] = []
    prior = 0
    for frame in frames:
        if length == 0:
            start_s, size = frame.capture_s, (frame.width, frame.height)
        length = frame.seq + 1
        results = pipeline.process(frame, frame.received_s)
        pipeline.check_fit()
        for result in results:
            if not result.decided or result.detection is None:
                continue
            prior = result.prior
            found = [
                (detected.x, detected.y, detected.w, detected.h) for detected in result.detection.counted
            ]
            owner += [len(decided)] * len(found)
            boxes += found
            decided.append((frame.seq + 1, frame.capture_s - start_s, result.detection.alarming))
    if not decided:
        raise LumpwatchError(f"{video}: the filter could not judge any frame")
    numbers, times, alarming = zip(*decided, strict=True)
    return Recording(
        np.array(numbers, dtype=np.intp),
        np.array(times),
        np.array(alarming),
        np.array(owner, dtype=np.intp),
        np.array(boxes, dtype=float).reshape(-1, 4),
        *size,
        length,
        prior,
    )


def record_all(
    tasks: Sequence[Task], executor: Executor, advance: Callable[[int], None] = lambda _: None
) -> list[Recording | Failure]:
    """Do all tasks; results in their order. `advance` is called with how many are done.

    Raises LumpwatchError where a worker is lost, for then nothing is known of its tasks.
    """
    futures: list[Future[Recording | Failure]] = []
    try:
        futures += [executor.submit(record, task) for task in tasks]
        for done, _ in enumerate(as_completed(futures), start=1):
            advance(done)
        return [future.result() for future in futures]
    except BrokenExecutor as error:
        raise LumpwatchError("a worker process ended in the middle of its work (out of memory?)") from error
    finally:
        for future in futures:
            future.cancel()
