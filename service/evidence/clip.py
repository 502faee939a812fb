"""Frames as a video without loss (FFV1 in Matroska), and their times and places beside it.

The video is for any player and keeps every byte; the container rounds times to a millisecond, so the
exact ones stand in `frames.jsonl`, one line a frame.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.core import BlindReason, Frame, PictureQuality, read_bounded
from lumpwatch.service.errors import LumpwatchError

_MS = Fraction(1, 1000)
_FORMATS = {"gray8": "gray", "i420": "yuv420p", "bgr8": "gray"}


class ClipError(LumpwatchError):
    """A clip cannot be read; the text names the file."""


def write_clip(path: Path, frames: Sequence[Frame]) -> None:
    """Write frames of one shape and encoding. Raises OSError and av.error.FFmpegError."""
    pictures = [_flat(frame.data) for frame in frames]
    write_video(path, pictures, frames, _FORMATS[frames[0].encoding])


def write_video(
    path: Path, pictures: Sequence[NDArray[np.uint8]], frames: Sequence[Frame], pixels: str
) -> None:
    """Write pictures, gray, yuv420p or bgr24, with the times of `frames`. Raises OSError and av.error.FFmpegError."""
    import av  # only a process that has a clip to write or read loads FFmpeg

    with av.open(str(path), "w", format="matroska") as container:
        rate = _rate(frames)
        stream = container.add_stream("ffv1", rate=rate, options={"level": "3"})
        height, stream.width = pictures[0].shape[:2]
        stream.height = height * 2 // 3 if pixels == "yuv420p" else height
        # FFV1 codes RGB as a fourth, unused byte has it.
        stream.pix_fmt = stored = "bgr0" if pixels == "bgr24" else pixels
        stream.time_base = stream.codec_context.time_base = _MS
        stream.codec_context.thread_count = 1
        last = -1
        for picture, frame in zip(pictures, frames, strict=True):
            coded = av.VideoFrame.from_ndarray(picture, format=pixels).reformat(format=stored)
            last = max(last + 1, round(1000 * (frame.capture_s - frames[0].capture_s)))
            coded.pts, coded.time_base = last, _MS
            container.mux(stream.encode(coded))
        container.mux(stream.encode(None))


def read_pictures(path: Path) -> Iterator[NDArray[np.uint8]]:
    """All pictures as they were stored, colour planes below luma. Raises ClipError."""
    import av

    try:
        with av.open(f"file:{path}") as container:
            for coded in container.decode(video=0):
                yield np.asarray(coded.to_ndarray(), dtype=np.uint8)
    except (av.error.FFmpegError, OSError, ValueError, IndexError) as error:
        raise ClipError(f"{path}: cannot be decoded ({error})") from error


def sidecar(frame: Frame, now_s: float, quality: PictureQuality) -> bytes:
    """One line of `frames.jsonl`: all of a frame but its pixels, when it was decided, and how fit it was."""
    fields = {
        "seq": frame.seq,
        "capture_s": frame.capture_s,
        "received_s": frame.received_s,
        "wall_s": frame.wall_s,
        "now_s": now_s,
        "size": (frame.width, frame.height),
        "encoding": frame.encoding,
        "shape": frame.data.shape,
        "crop": frame.crop,
        "reduction": frame.reduction,
        "quality": {
            "reason": quality.reason,
            "suspect": quality.suspect,
            "held_off": quality.held_off,
            "offset_px": quality.offset_px,
            "standing": quality.standing,
        },
    }
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def read_frames(video: Path, times: Path) -> Iterator[tuple[Frame, float, PictureQuality]]:
    """The frames, when each was decided, and what was judged of its quality. Raises ClipError."""
    try:
        lines = [json.loads(line) for line in read_bounded(times).splitlines()]
    except (OSError, ValueError, RecursionError) as error:
        raise ClipError(f"{times}: cannot be read ({error})") from error
    count = 0
    for count, picture in enumerate(read_pictures(video), start=1):
        if count > len(lines):
            raise ClipError(f"{video}: holds more pictures than {times.name} has lines ({len(lines)})")
        try:
            yield _frame(lines[count - 1], picture)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise ClipError(f"{times}, line {count}: is not as expected ({error})") from error
    if count < len(lines):
        raise ClipError(f"{video}: holds {count} pictures, {times.name} has {len(lines)} lines")


def _frame(header: dict[str, Any], picture: NDArray[np.uint8]) -> tuple[Frame, float, PictureQuality]:
    frame = Frame(
        seq=int(header["seq"]),
        capture_s=float(header["capture_s"]),
        received_s=float(header["received_s"]),
        wall_s=float(header["wall_s"]),
        width=int(header["size"][0]),
        height=int(header["size"][1]),
        encoding=header["encoding"],
        data=picture.reshape(header["shape"]),
        crop=None if header["crop"] is None else tuple(header["crop"]),
        reduction=int(header["reduction"]),
    )
    judged = header["quality"]
    quality = PictureQuality(
        reason=None if judged["reason"] is None else BlindReason(judged["reason"]),
        suspect=bool(judged["suspect"]),
        held_off=bool(judged["held_off"]),
        offset_px=(int(judged["offset_px"][0]), int(judged["offset_px"][1])),
        standing=tuple(int(i) for i in judged.get("standing", ())),  # unknown before 0.2
    )
    return frame, float(header["now_s"]), quality


def _flat(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 3) as (h, 3 w): kept to the byte without a conversion of colours."""
    return np.ascontiguousarray(picture.reshape(picture.shape[0], -1))


def _rate(frames: Sequence[Frame]) -> Fraction:
    """Mean frame rate, for players."""
    span_s = frames[-1].capture_s - frames[0].capture_s
    rate = (len(frames) - 1) / span_s if span_s > 0 else 10.0
    return Fraction(min(max(rate, 0.1), 1000.0)).limit_denominator(1000)
