"""Frames on the wire: exact headers, round trips, and whatever a stranger may send."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.bus.codec import (
    MAX_HEADER_BYTES,
    decode_header,
    decode_pixels,
    encode_frame,
    encode_jpeg,
)
from lumpwatch.service.bus.errors import Malformation, MalformedMessage
from lumpwatch.service.core.frame import Encoding, Frame

CLOCK = "clock-1"


def decoded(payload: bytes, attachment: bytes) -> Frame:
    return decode_pixels(payload, decode_header(attachment))


def shape_of(encoding: Encoding, width: int, height: int, reduction: int = 1) -> tuple[int, ...]:
    width, height = width // reduction, height // reduction
    shapes = {
        "gray8": (height, width),
        "i420": (height * 3 // 2, width),
        "bgr8": (height, width, 3),
    }
    return shapes[encoding]


def flat(encoding: Encoding, width: int, height: int, value: int = 128, **more: Any) -> Frame:
    data = np.full(shape_of(encoding, width, height), value, np.uint8)
    return Frame(7, 1.5, 1.25, 1e9, width, height, encoding, data, **more)


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    encoding: Encoding = draw(st.sampled_from(["gray8", "i420", "bgr8"]))
    step = 2 if encoding == "i420" else 1
    reduction = draw(st.sampled_from([1, 2, 4])) if encoding == "gray8" else 1
    w, h = (step * draw(st.integers(reduction, 24)) for _ in range(2))
    x, y, right, bottom = (draw(st.integers(0, 9)) for _ in range(4))
    shape = shape_of(encoding, w, h, reduction)
    data = np.random.default_rng(draw(st.integers(0, 99))).integers(0, 256, shape, np.uint8)
    times = st.floats(-1e6, 4e9)
    return Frame(
        seq=draw(st.integers(0, 2**53 - 1)),
        capture_s=draw(times),
        received_s=draw(times),
        wall_s=draw(times),
        width=x + w + right,
        height=y + h + bottom,
        encoding=encoding,
        data=data,
        crop=(x, y, w, h),
        reduction=reduction,
    )


def same_but_pixels(got: Frame, sent: Frame) -> bool:
    times = ((got.capture_s, sent.capture_s), (got.received_s, sent.received_s), (got.wall_s, sent.wall_s))
    return (got.seq, got.width, got.height, got.encoding, got.crop, got.reduction, got.data.shape) == (
        (sent.seq, sent.width, sent.height, sent.encoding, sent.crop, sent.reduction, sent.data.shape)
    ) and all(abs(a - b) <= 1e-9 + 1e-15 * abs(b) for a, b in times)


def test_header_is_the_documented_json() -> None:
    data = np.arange(6, dtype=np.uint8).reshape(2, 3)
    frame = Frame(5, 1.5, 1.75, 1_000_000_000.25, 10, 8, "gray8", data, crop=(4, 5, 3, 2))
    payload, attachment = encode_frame(frame, CLOCK)
    assert payload == bytes([0, 1, 2, 3, 4, 5])
    assert json.loads(attachment) == {
        "v": 1,
        "clock": "clock-1",
        "seq": 5,
        "capture_ns": 1_500_000_000,
        "received_ns": 1_750_000_000,
        "wall_ns": 1_000_000_000_250_000_000,
        "size": [10, 8],
        "crop": [4, 5, 3, 2],
        "reduction": 1,
        "encoding": "gray8",
        "pixels": "gray8",
        "shape": [2, 3],
    }


@given(frames())
def test_raw_round_trip(frame: Frame) -> None:
    got = decoded(*encode_frame(frame, CLOCK))
    assert same_but_pixels(got, frame)
    np.testing.assert_array_equal(got.data, frame.data)


@settings(max_examples=50)
@given(frames())
def test_jpeg_round_trip_keeps_all_but_exact_pixels(frame: Frame) -> None:
    frame = replace(frame, data=np.full_like(frame.data, 128))
    payload, attachment = encode_jpeg(frame, 95, CLOCK)
    got = decoded(payload, attachment)
    assert payload.startswith(b"\xff\xd8")
    assert decode_header(attachment).encoding == "jpeg"
    assert same_but_pixels(got, frame)
    assert np.abs(got.data.astype(int) - 128).max() <= 3


def test_whole_picture_has_no_crop_and_raw_pixels_are_a_view() -> None:
    payload, attachment = encode_frame(flat("gray8", 4, 2), CLOCK)
    got = decoded(payload, attachment)
    assert got.crop is None
    assert not got.data.flags.writeable
    assert np.shares_memory(got.data, np.frombuffer(payload, np.uint8))


def test_a_reduced_frame_holds_fewer_pixels_than_its_crop() -> None:
    frame = replace(flat("gray8", 9, 7), data=np.zeros((3, 4), np.uint8), reduction=2)
    payload, attachment = encode_frame(frame, CLOCK)
    got = decoded(payload, attachment)
    assert len(payload) == 12
    assert (got.width, got.height, got.reduction, got.data.shape) == (9, 7, 2, (3, 4))


def test_strided_pixels_travel_as_they_look() -> None:
    wide = np.arange(24, dtype=np.uint8).reshape(4, 6)
    frame = replace(flat("gray8", 3, 4), data=wide[:, ::2])
    np.testing.assert_array_equal(decoded(*encode_frame(frame, CLOCK)).data, wide[:, ::2])


def test_jpeg_of_i420_keeps_colour() -> None:
    bgr = np.zeros((32, 32, 3), np.uint8)
    bgr[..., 2] = 200
    data = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420), np.uint8)
    payload, attachment = encode_jpeg(replace(flat("i420", 32, 32), data=data), 95, CLOCK)
    shown = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert np.abs(shown.astype(int) - bgr).max() <= 6
    assert np.abs(decoded(payload, attachment).data.astype(int) - data).max() <= 4


@pytest.mark.parametrize(
    "frame",
    [
        replace(flat("gray8", 4, 4), data=np.zeros((4, 5), np.uint8)),
        replace(flat("gray8", 4, 4), encoding="bgr8"),
        replace(flat("gray8", 4, 4), crop=(0, 0, 2, 2)),
        replace(flat("i420", 4, 4), width=5, data=np.zeros((6, 5), np.uint8)),
    ],
)
def test_a_frame_that_contradicts_itself_is_not_sent(frame: Frame) -> None:
    with pytest.raises(ValueError, match="frame 7"):
        encode_frame(frame, CLOCK)
    with pytest.raises(ValueError, match="frame 7"):
        encode_jpeg(frame, 80, CLOCK)


def reason_of(payload: bytes, attachment: bytes) -> Malformation:
    with pytest.raises(MalformedMessage) as caught:
        decoded(payload, attachment)
    return caught.value.reason


def header(**changes: Any) -> bytes:
    fields = json.loads(encode_frame(flat("gray8", 8, 8), CLOCK)[1])
    return json.dumps(fields | changes).encode()


@pytest.mark.parametrize(
    ("attachment", "reason"),
    [
        (b"", Malformation.NO_HEADER),
        (b" " * (MAX_HEADER_BYTES + 1), Malformation.HEADER_TOO_LONG),
        (b"{", Malformation.BAD_HEADER),
        (b"[]", Malformation.BAD_HEADER),
        (b"null", Malformation.BAD_HEADER),
        (b"\xff\xfe", Malformation.BAD_HEADER),
        (b"[" * 4000, Malformation.BAD_HEADER),
        (header(v=2), Malformation.UNKNOWN_VERSION),
        (header(v=2, seq="later"), Malformation.UNKNOWN_VERSION),
        (header(seq=-1), Malformation.BAD_HEADER),
        (header(seq=1.0), Malformation.BAD_HEADER),
        (header(seq="1"), Malformation.BAD_HEADER),
        (header(wall_ns=2**63), Malformation.BAD_HEADER),
        (header(seq=2**53), Malformation.BAD_HEADER),  # nobody counts so far, and JSON cannot
        (header(clock=""), Malformation.BAD_HEADER),
        (header(more=1), Malformation.BAD_HEADER),
        (header(pixels="nv12"), Malformation.BAD_HEADER),
        (header(encoding="bgr8"), Malformation.BAD_SHAPE),
        (header(shape=[8, 9]), Malformation.BAD_SHAPE),
        (header(shape=[8]), Malformation.BAD_SHAPE),
        (header(shape=[8, 8, 3]), Malformation.BAD_SHAPE),
        (header(size=[0, 8]), Malformation.BAD_SHAPE),
        (header(size=[16385, 8], shape=[8, 16385]), Malformation.BAD_SHAPE),
        (header(reduction=3), Malformation.BAD_HEADER),
        (header(reduction=2), Malformation.BAD_SHAPE),
        (header(reduction=16, shape=[0, 0]), Malformation.BAD_SHAPE),
        (
            header(reduction=2, encoding="bgr8", pixels="bgr8", shape=[4, 4, 3]),
            Malformation.BAD_SHAPE,
        ),
        (header(crop=[1, 0, 8, 8]), Malformation.BAD_SHAPE),
        (header(crop=[-1, 0, 8, 8]), Malformation.BAD_SHAPE),
        (header(size=[7, 8], pixels="i420", encoding="i420", shape=[12, 7]), Malformation.BAD_SHAPE),
        (header(size=[16384, 16384], shape=[16384, 16384]), Malformation.BAD_LENGTH),
        (header(size=[8, 7], shape=[7, 8]), Malformation.BAD_LENGTH),
        (header(encoding="jpeg"), Malformation.BAD_JPEG),
    ],
)
def test_every_malformation_has_its_reason(attachment: bytes, reason: Malformation) -> None:
    assert reason_of(bytes(64), attachment) == reason


def test_empty_payload() -> None:
    assert reason_of(b"", header()) == Malformation.BAD_LENGTH
    assert reason_of(b"", header(encoding="jpeg")) == Malformation.BAD_LENGTH


def test_jpeg_of_another_size_truncated_progressive_or_in_colour() -> None:
    payload, attachment = encode_jpeg(flat("gray8", 64, 48), 90, CLOCK)
    assert decoded(payload, attachment).data.shape == (48, 64)
    other, _ = encode_jpeg(flat("gray8", 48, 64), 90, CLOCK)
    colour, _ = encode_jpeg(flat("bgr8", 64, 48), 90, CLOCK)
    ok, progressive = cv2.imencode(".jpg", flat("gray8", 64, 48).data, (cv2.IMWRITE_JPEG_PROGRESSIVE, 1))
    assert ok
    for wrong in (other, colour, progressive.tobytes(), payload[:-1], payload[2:], b"\xff\xd8\xff\xd9"):
        assert reason_of(wrong, attachment) == Malformation.BAD_JPEG


def test_a_small_jpeg_under_a_huge_size_is_not_decoded() -> None:
    payload, _ = encode_jpeg(flat("gray8", 64, 48), 90, CLOCK)
    at = payload.index(b"\xff\xc0") + 5
    bomb = payload[:at] + b"\x40\x00\x40\x00" + payload[at + 4 :]
    attachment = header(encoding="jpeg", size=[16384, 16384], shape=[16384, 16384])
    assert reason_of(bomb, attachment) == Malformation.BAD_JPEG


def test_a_huge_shape_allocates_nothing() -> None:
    attachment = header(size=[16384, 16384], encoding="bgr8", pixels="bgr8", shape=[16384, 16384, 3])
    tracemalloc.start()
    try:
        assert reason_of(bytes(1000), attachment) == Malformation.BAD_LENGTH
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def decode_or_refuse(payload: bytes, attachment: bytes) -> None:
    """Either a frame that agrees with itself or MalformedMessage: nothing else may come out."""
    try:
        got = decoded(payload, attachment)
    except MalformedMessage:
        return
    _, _, w, h = got.window
    assert got.data.shape == shape_of(got.encoding, w, h, got.reduction)


@given(st.binary(max_size=300), st.binary(max_size=300))
def test_random_bytes(payload: bytes, attachment: bytes) -> None:
    decode_or_refuse(payload, attachment)


TEXT = st.text('ab1é"\\\0 \n', max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXT,
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@given(st.data())
def test_header_with_some_fields_replaced(data: st.DataObject) -> None:
    fields = json.loads(header())
    for name in data.draw(st.lists(st.sampled_from(sorted(fields)), max_size=3)):
        fields[name] = data.draw(JSON | st.sampled_from(["gray8", "bgr8", "i420", "jpeg", [8, 8], [8, 8, 3]]))
    decode_or_refuse(bytes(data.draw(st.sampled_from([0, 64, 96, 192]))), json.dumps(fields).encode())


@given(st.binary(min_size=1, max_size=4), st.integers(0, 10_000), st.booleans())
def test_header_or_jpeg_with_some_bytes_replaced(noise: bytes, at: int, in_header: bool) -> None:
    parts = list(encode_jpeg(flat("bgr8", 32, 16), 80, CLOCK))
    part = parts[in_header]
    at %= len(part)
    parts[in_header] = part[:at] + noise + part[at + len(noise) :]
    decode_or_refuse(*parts)
