"""One configuration on one video: what the filter finds in each frame, before any threshold.

Tasks are independent of each other, and all that they need travels with them: any executor in the
shape of `concurrent.futures` can do them, a pool on this machine or a cluster (see `lumpwatch.service.batch`).
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.batch import Finished, Task, file_identity, key_of
from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import Frame
from lumpwatch.service.detection import CameraPipeline
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Prior, encode_prior, load_arrays

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
_MOST_BYTES = 1 << 30


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
class Watch:
    """What is to be done: a configuration looks at a video."""

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


def tasks_of(setups: Sequence[Setup], videos: Sequence[Path]) -> list[Task[Watch]]:
    """Every configuration on every video: each with a name, its weight in bytes, and the key of all that its result
    depends on.

    A video that cannot be looked at has no key; its task says why it fails.
    """
    seen = [_looked_at(video) for video in videos]
    tasks = []
    for setup in setups:
        prior = b"" if setup.prior is None else encode_prior(setup.prior) + str(setup.prior.version).encode()
        camera = setup.camera.model_dump_json()
        for video, found in zip(videos, seen, strict=True):
            task = Task(str(video), Watch(setup, video))
            if found is not None:
                identity, size = found
                key = key_of("backtest", camera, prior, str(video.name), identity)
                task = replace(task, key=key, weight=float(max(size, 1)))
            tasks.append(task)
    return tasks


def _looked_at(video: Path) -> tuple[str, int] | None:
    """What tells it from others, and its bytes."""
    try:
        size = sum(one.stat().st_size for one in (video.iterdir() if video.is_dir() else [video]))
        return file_identity(video), size
    except OSError:
        return None


def record_video(watch: Watch) -> Recording:
    """Do it. Raises LumpwatchError for a video that cannot be used."""
    frames, _ = read_frames(watch.setup.camera, watch.video)
    with closing(frames):
        return record_frames(watch.setup, frames, watch.video)


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


def finished_recordings(folder: Path) -> Finished[Recording]:
    """Recordings that are kept in a folder. Raises LumpwatchError."""
    return Finished(folder, encode_recording, decode_recording)


def encode_recording(recording: Recording) -> bytes:
    """As a NumPy archive; the same recording gives the same bytes."""
    buffer = io.BytesIO()
    numbers = np.array([recording.width, recording.height, recording.length, recording.prior], dtype=np.int64)
    np.savez(
        buffer,
        allow_pickle=False,
        frames=recording.frames,
        times=recording.times,
        alarming=recording.alarming,
        owner=recording.owner,
        boxes=recording.boxes,
        numbers=numbers,
    )
    return buffer.getvalue()


def decode_recording(content: bytes) -> Recording:
    """The recording again. Raises ValueError or KeyError."""
    arrays = load_arrays(content, _MOST_BYTES)
    width, height, length, prior = arrays["numbers"].tolist()
    return Recording(
        arrays["frames"],
        arrays["times"],
        arrays["alarming"],
        arrays["owner"],
        arrays["boxes"],
        width,
        height,
        length,
        prior,
    )
