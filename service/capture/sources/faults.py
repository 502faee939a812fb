"""What FFmpeg's errors mean. Their texts can hold the whole URL, so none of them is passed on."""

from __future__ import annotations

import os

import av.error
from av import FFmpegError
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.decoding import refusing

_TEXT = frozenset({"tty", "bin", "xbin", "adf", "idf"})
"""FFmpeg's readers of text."""
_WORDS = {
    Fault.UNAUTHORISED: "user or password refused",
    Fault.NOT_FOUND: "no such stream",
    Fault.CERTIFICATE: "the camera's certificate is refused",
    Fault.OPEN_TIMEOUT: "no answer in time",
    Fault.CODEC: "no decoder for this kind of stream",
    Fault.CORRUPT: "damaged, or not a video",
}


def fault_of(error: FFmpegError, otherwise: Fault) -> Fault:
    """The fault that the type of the error stands for."""
    match error:
        case av.error.HTTPUnauthorizedError() | av.error.HTTPForbiddenError():
            return Fault.UNAUTHORISED
        case av.error.HTTPNotFoundError():
            return Fault.NOT_FOUND
        case av.error.ExitError() | av.error.TimeoutError():
            return Fault.OPEN_TIMEOUT
        case av.error.DecoderNotFoundError() | av.error.DemuxerNotFoundError() | av.error.PatchWelcomeError():
            return Fault.CODEC
        case _:
            return otherwise


def source_error(name: str, fault: Fault, error: FFmpegError) -> SourceError:
    """A SourceError in words of our own; raise it outside the `except`, so that no context keeps the URL."""
    words = _WORDS.get(fault)
    if words is None:
        number = error.errno or 0
        words = os.strerror(number).lower() if 0 < number < 200 else "the server answered with an error"
    return SourceError(fault, f"{name}: {words}")


def video_stream(container: InputContainer, name: str) -> VideoStream:
    """The video stream, ready to decode in one thread; raises SourceError(CODEC).

    The first one of a camera, of a file the one that players show. Not a cover picture, nor text: FFmpeg draws any text
    as a film of its letters.
    """
    films = [one for one in container.streams.video if not one.disposition & Disposition.attached_pic]
    if not films:
        raise SourceError(Fault.CODEC, f"{name}: holds no video stream")
    if container.format.name in _TEXT:
        raise SourceError(Fault.CODEC, f"{name}: is text, not a video")
    stream = films[0] if container.format.name == "rtsp" else max(films, key=_rank)
    if stream.codec_context is None:
        raise SourceError(Fault.CODEC, f"{name}: no decoder for its video stream")
    # Threads that decode frames side by side would hold each frame back by one per thread.
    stream.thread_type = "NONE"
    stream.codec_context.options = refusing(stream.codec_context.name)
    return stream


def _rank(stream: VideoStream) -> tuple[bool, int]:
    context = stream.codec_context  # None where nothing decodes it
    area = 0 if context is None else context.width * context.height
    return bool(stream.disposition & Disposition.default), area


def frame_rate(stream: VideoStream) -> float | None:
    """Frames a second as the stream states them."""
    rate = stream.average_rate or stream.guessed_rate
    return float(rate) if rate else None
