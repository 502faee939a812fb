"""Refining a prior: training anew on all confirmed clips at once, old and new.

The clips are joined into one recording: frames count on, times go on after a pause, and no object is the
same as one of another clip. So all that training learns is learned from the pool, and nothing that the
earlier clips showed is forgotten.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path
from statistics import median

from lumpwatch.service.capture import read_frames
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import Frame
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import Box, check_frames
from lumpwatch.service.training.footage import TrainingError
from lumpwatch.service.training.learner import Trained, train

PAUSE_S = 60.0
"""Between clips: so long that nothing seems to move from the end of one to the beginning of the next."""
_RATE_TOLERANCE = 0.1


@dataclass(frozen=True, slots=True)
class ConfirmedClip:
    """Footage of which a person has confirmed what is a lump and what is none."""

    name: str
    """For people and for the prior's record of where it comes from."""
    boxes: tuple[Box, ...]
    """Every lump in every frame, frames from 1; empty: a confirmed false alarm."""
    frames: Callable[[], Iterable[Frame]]
    """Reads the frames from the first to the last; called twice."""


def recorded_clip(camera: CameraConfig, name: str, video: Path, boxes: tuple[Box, ...]) -> ConfirmedClip:
    """A clip from a video file or a folder of images."""
    return ConfirmedClip(name, boxes, lambda: read_frames(camera, video)[0])


def refine(
    roi: RoiConfig, clips: Sequence[ConfirmedClip], advance: Callable[[int], None] = lambda _: None
) -> Trained:
    """Learn one ROI from all clips. `advance` is told the number of frames read. Raises LumpwatchError."""
    if not any(clip.boxes for clip in clips):
        raise TrainingError("no clip has a labelled lump")
    frames, boxes = joined_footage(clips)
    return train(roi, frames, boxes, Path("clips"), "the clips", advance)


def joined_footage(clips: Sequence[ConfirmedClip]) -> tuple[Iterator[Frame], tuple[Box, ...]]:
    """All clips as one recording with its labels; raises LumpwatchError where they do not go together."""
    summaries = [_summary_of(clip) for clip in clips]
    slowest_s = max(summary.interval_s for summary in summaries)
    # A recording, or a clip of before `decide_hz`, holds more frames a second than a clip of what was decided.
    strides = [round(slowest_s / summary.interval_s) for summary in summaries]
    for clip, summary, stride in zip(clips, summaries, strides, strict=True):
        if summary.size != summaries[0].size:
            raise TrainingError(
                f"{clip.name}: has pictures of {summary.size[0]}x{summary.size[1]}, "
                f"{clips[0].name} of {summaries[0].size[0]}x{summaries[0].size[1]}"
            )
        if abs(stride * summary.interval_s / slowest_s - 1.0) > _RATE_TOLERANCE:
            raise TrainingError(
                f"{clip.name}: has {1 / summary.interval_s:.1f} frames a second, another clip {1 / slowest_s:.1f}, "
                "which is no whole share of that"
            )
    boxes: list[Box] = []
    first, tracks = 0, 0
    for clip, summary, stride in zip(clips, summaries, strides, strict=True):
        numbers = {track: tracks + k for k, track in enumerate(sorted({box.track for box in clip.boxes}), 1)}
        boxes += [
            replace(box, frame=(box.frame - 1) // stride + 1 + first, track=numbers[box.track])
            for box in clip.boxes
            if (box.frame - 1) % stride == 0
        ]
        first, tracks = first + -(-summary.count // stride), tracks + len(numbers)
    return _joined(clips, strides), tuple(boxes)


@dataclass(frozen=True, slots=True)
class _ClipSummary:
    count: int
    interval_s: float
    size: tuple[int, int]


def _summary_of(clip: ConfirmedClip) -> _ClipSummary:
    """How long a clip is and how it was taken; raises LumpwatchError naming the clip."""
    times, size = [], (0, 0)
    try:
        for frame in clip.frames():
            times.append(frame.capture_s)
            size = (frame.width, frame.height)
    except LumpwatchError as error:
        raise TrainingError(f"{clip.name}: {error}") from error
    if len(times) < 2:
        raise TrainingError(f"{clip.name}: has fewer than two frames")
    interval_s = median(after - before for before, after in pairwise(times))
    if not interval_s > 0:
        raise TrainingError(f"{clip.name}: its frames carry no advancing time stamps")
    if clip.boxes:
        check_frames(clip.boxes, len(times), Path(clip.name), "the clip")
    return _ClipSummary(len(times), interval_s, size)


def _joined(clips: Sequence[ConfirmedClip], strides: Sequence[int]) -> Iterator[Frame]:
    seq, end_s = 0, 0.0
    for clip, stride in zip(clips, strides, strict=True):
        offset_s: float | None = None
        for frame in islice(clip.frames(), None, None, stride):
            if offset_s is None:
                offset_s = end_s - frame.capture_s
            end_s = frame.capture_s + offset_s
            yield replace(frame, seq=seq, capture_s=end_s, received_s=end_s)
            seq += 1
        end_s += PAUSE_S
