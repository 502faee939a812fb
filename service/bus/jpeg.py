"""JPEG for the wire: what comes in is measured before it is decoded."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.bus.errors import Malformation, MalformedMessage
from lumpwatch.service.core import Encoding

_MAX_SEGMENTS = 64
_SOI, _EOI = b"\xff\xd8", b"\xff\xd9"
_BASELINE = (0xC0, 0xC1)
# Frame types that are not accepted, start of scan, and markers that have no business in a header.
_REFUSED = frozenset({*range(0xC2, 0xD0), *range(0xD0, 0xDB)} - {0xC4})


def encode(data: NDArray[np.uint8], pixels: Encoding, quality: int) -> bytes:
    """Baseline JPEG of the pixels; i420 goes through BGR, so it can be shown by any viewer."""
    picture = cv2.cvtColor(data, cv2.COLOR_YUV2BGR_I420) if pixels == "i420" else data
    ok, buffer = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, quality))
    if not ok:
        raise ValueError(f"cannot make a JPEG of {picture.shape[1]}x{picture.shape[0]}")
    return bytes(buffer.data)


def decode(payload: bytes, pixels: Encoding, width: int, height: int) -> NDArray[np.uint8]:
    """The pixels of a JPEG that must have this size; raises MalformedMessage for any other payload."""
    components = 1 if pixels == "gray8" else 3
    if _measure(payload) != (width, height, components):
        raise MalformedMessage(Malformation.BAD_JPEG)
    # A block of 8x8 pixels takes two bits at the least: less data under a large size is a bomb.
    if len(payload) < width * height // 256:
        raise MalformedMessage(Malformation.BAD_JPEG)
    flags = (cv2.IMREAD_GRAYSCALE if pixels == "gray8" else cv2.IMREAD_COLOR) | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(np.frombuffer(payload, np.uint8), flags)
    except cv2.error as error:
        raise MalformedMessage(Malformation.BAD_JPEG) from error
    if picture is None or picture.shape[:2] != (height, width):
        raise MalformedMessage(Malformation.BAD_JPEG)
    if pixels == "i420":
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    return np.asarray(picture, np.uint8)


def _measure(payload: bytes) -> tuple[int, int, int]:
    """Width, height and number of components as the header of a whole baseline JPEG states them."""
    if not (payload.startswith(_SOI) and payload.endswith(_EOI)):
        raise MalformedMessage(Malformation.BAD_JPEG)
    at = 2
    for _ in range(_MAX_SEGMENTS):
        head = payload[at : at + 10]
        if len(head) < 10 or head[0] != 0xFF or head[1] in _REFUSED:
            break
        if head[1] in _BASELINE:
            return int.from_bytes(head[7:9], "big"), int.from_bytes(head[5:7], "big"), head[9]
        at += 2 + max(2, int.from_bytes(head[2:4], "big"))
    raise MalformedMessage(Malformation.BAD_JPEG)
