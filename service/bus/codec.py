"""Frames on the wire: pixels as payload, everything else as a JSON header in the attachment.

The header (version 1) is `{"v": 1, "clock": str, "seq": int, "capture_ns": int, "received_ns": int,
"wall_ns": int, "size": [w, h], "crop": [x, y, w, h] | null, "reduction": 1 | 2 | 4 …, "encoding": "gray8" |
"i420" | "bgr8" | "jpeg", "pixels": "gray8" | "i420" | "bgr8", "shape": [...], "thumb": [h, w] | null,
"source": str}`. `source` tells the publisher from all others of the key: 16 hexadecimal digits. A thumb, the whole
picture small and gray, is the end of the payload, uncompressed. `encoding` is that of the payload,
`pixels` and `shape` those of the array that comes out of decoding. `clock` names the monotonic clock
of `capture_ns` and `received_ns`: under another name they cannot be compared with one's own clock.
"""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from lumpwatch.service.bus import jpeg
from lumpwatch.service.bus.errors import Malformation, MalformedMessage
from lumpwatch.service.core import Encoding, Frame

WireEncoding = Literal["raw", "jpeg"]

MAX_SIDE: Final = 16_384
MAX_HEADER_BYTES: Final = 4_096
_NS: Final = 1_000_000_000
_SOURCE: Final = re.compile(rb'"source"\s*:\s*"([0-9a-f]{16})"')

_Side = Annotated[int, Field(ge=1, le=MAX_SIDE)]
_Offset = Annotated[int, Field(ge=0, lt=MAX_SIDE)]
_ThumbSide = Annotated[int, Field(ge=1, le=512)]
_Length = Annotated[int, Field(ge=1, le=2 * MAX_SIDE)]
_Nanoseconds = Annotated[int, Field(gt=-(2**63), lt=2**63)]


class FrameHeader(BaseModel):
    """The attachment of a frame; sizes in pixels, times in integer nanoseconds."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    v: Literal[1]
    clock: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    seq: Annotated[int, Field(ge=0, lt=2**53)]
    capture_ns: _Nanoseconds
    received_ns: _Nanoseconds
    wall_ns: _Nanoseconds
    size: tuple[_Side, _Side]
    crop: tuple[_Offset, _Offset, _Side, _Side] | None
    reduction: Literal[1, 2, 4, 8, 16, 32, 64]
    encoding: Literal["gray8", "i420", "bgr8", "jpeg"]
    pixels: Encoding
    shape: Annotated[tuple[_Length, ...], Field(min_length=2, max_length=3)]
    thumb: tuple[_ThumbSide, _ThumbSide] | None = None
    source: Annotated[str, StringConstraints(pattern=r"^(?:[0-9a-f]{16})?$")] = ""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.encoding not in (self.pixels, "jpeg"):
            raise ValueError("encoding and pixels differ")
        x, y, w, h = self.crop or (0, 0, *self.size)
        if x + w > self.size[0] or y + h > self.size[1]:
            raise ValueError("the crop is outside the picture")
        if self.reduction > 1 and self.pixels != "gray8":
            raise ValueError("only gray8 can be reduced")
        if self.shape != _shape(self.pixels, w // self.reduction, h // self.reduction):
            raise ValueError("the shape is not that of the pixels")
        return self

    @property
    def window_size(self) -> tuple[int, int]:
        """Width and height of the pixels that travel."""
        w, h = self.crop[2:] if self.crop else self.size
        return w // self.reduction, h // self.reduction

    @property
    def thumb_length(self) -> int:
        """Bytes of the thumb at the end of the payload."""
        return math.prod(self.thumb) if self.thumb else 0

    def check_length(self, length: int) -> None:
        """Raise MalformedMessage when a payload of so many bytes cannot be that of this header."""
        length -= self.thumb_length
        if length <= 0 or (self.encoding != "jpeg" and length != math.prod(self.shape)):
            raise MalformedMessage(Malformation.BAD_LENGTH)


def encode_frame(frame: Frame, clock: str, source: str = "") -> tuple[bytes, bytes]:
    """Payload (raw pixels) and attachment; ValueError for a frame that contradicts itself."""
    return frame.data.tobytes() + _thumb(frame), _header(frame, clock, frame.encoding, source)


def encode_jpeg(frame: Frame, quality: int, clock: str, source: str = "") -> tuple[bytes, bytes]:
    """Payload (JPEG, quality 1 to 100) and attachment; ValueError for a frame that contradicts itself."""
    header = _header(frame, clock, "jpeg", source)
    return jpeg.encode(frame.data, frame.encoding, quality) + _thumb(frame), header


def source_of(attachment: bytes) -> str:
    """Who says to have sent a frame, found without decoding its header; empty where nobody is named."""
    match = _SOURCE.search(attachment)
    return "" if match is None else match[1].decode()


def decode_header(attachment: bytes) -> FrameHeader:
    """The checked header; raises MalformedMessage, never anything else."""
    if not attachment:
        raise MalformedMessage(Malformation.NO_HEADER)
    if len(attachment) > MAX_HEADER_BYTES:
        raise MalformedMessage(Malformation.HEADER_TOO_LONG)
    try:
        return FrameHeader.model_validate_json(attachment)
    except ValidationError as error:
        raise MalformedMessage(_reason(error)) from error


def decode_pixels(payload: bytes, header: FrameHeader) -> Frame:
    """The frame of a header that was already checked; raises MalformedMessage, never anything else.

    Raw pixels are a read-only view of the payload.
    """
    header.check_length(len(payload))
    thumb = None
    if header.thumb is not None:
        thumb = np.frombuffer(payload, np.uint8, offset=len(payload) - header.thumb_length)
        thumb = thumb.reshape(header.thumb)
        payload = payload[: len(payload) - header.thumb_length]
    if header.encoding == "jpeg":
        data = jpeg.decode(payload, header.pixels, *header.window_size)
    else:
        data = np.frombuffer(payload, np.uint8).reshape(header.shape)
    return Frame(
        seq=header.seq,
        capture_s=header.capture_ns / _NS,
        received_s=header.received_ns / _NS,
        wall_s=header.wall_ns / _NS,
        width=header.size[0],
        height=header.size[1],
        encoding=header.pixels,
        data=data,
        crop=header.crop,
        reduction=header.reduction,
        thumb=thumb,
    )


def _header(frame: Frame, clock: str, encoding: str, source: str) -> bytes:
    _, _, w, h = frame.window
    w, h = w // frame.reduction, h // frame.reduction
    if frame.data.dtype != np.uint8 or frame.data.shape != _shape(frame.encoding, w, h):
        raise ValueError(
            f"frame {frame.seq}: data of shape {frame.data.shape} is not {frame.encoding} of {w}x{h}"
        )
    header = {
        "v": 1,
        "clock": clock,
        "seq": frame.seq,
        "capture_ns": round(frame.capture_s * _NS),
        "received_ns": round(frame.received_s * _NS),
        "wall_ns": round(frame.wall_s * _NS),
        "size": (frame.width, frame.height),
        "crop": frame.crop,
        "reduction": frame.reduction,
        "encoding": encoding,
        "pixels": frame.encoding,
        "shape": frame.data.shape,
    }
    if frame.thumb is not None:
        header["thumb"] = frame.thumb.shape
    if source:
        header["source"] = source
    return json.dumps(header, separators=(",", ":")).encode()


def _thumb(frame: Frame) -> bytes:
    return b"" if frame.thumb is None else frame.thumb.tobytes()


def _reason(error: ValidationError) -> Malformation:
    problems = [(p["loc"][:1], p["type"]) for p in error.errors(include_url=False, include_context=False)]
    if (("v",), "literal_error") in problems:
        return Malformation.UNKNOWN_VERSION
    if all(
        where in (("size",), ("crop",), ("shape",), ("thumb",)) or kind == "value_error"
        for where, kind in problems
    ):
        return Malformation.BAD_SHAPE
    return Malformation.BAD_HEADER


def _shape(pixels: Encoding, width: int, height: int) -> tuple[int, ...] | None:
    """Shape of the array of a picture of this size; None where the encoding cannot have it."""
    if pixels == "gray8":
        return height, width
    if pixels == "bgr8":
        return height, width, 3
    return (height * 3 // 2, width) if width % 2 == 0 == height % 2 else None
