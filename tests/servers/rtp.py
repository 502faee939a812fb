"""A video file as RTP payloads: H.264 (RFC 6184), H.265 (RFC 7798) and JPEG (RFC 2435)."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.bitstream import BitStreamFilterContext
from av.container import InputContainer
from av.video.stream import VideoStream

CLOCK_HZ = 90_000
MAX_PAYLOAD = 1400
_START_CODE = re.compile(b"\x00\x00\x00?\x01")


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One coded picture: its time in 90 kHz ticks since the first, and its NAL units or its JPEG."""

    ticks: int
    key: bool
    parts: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class Track:
    """All access units of a file, the lines that describe them in SDP, and how they are packed."""

    units: tuple[AccessUnit, ...]
    lap_ticks: int
    payload_type: int
    header_bytes: int
    """How much of a payload damage must spare, so that it still reaches the decoder."""
    sdp: tuple[str, ...]
    payloads: Callable[[AccessUnit], Iterator[bytes]]


def load(path: Path) -> Track:
    """Read the first video stream of the file into memory."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        rate = stream.average_rate or Fraction(25)
        codec = stream.codec_context.name
        if codec == "h264":
            units = _nal_units(container, stream, "h264_mp4toannexb", _key_h264)
            kind, payload_type, header, describe, payloads = "H264", 96, 2, _sdp_h264(units), payloads_h264
        elif codec == "hevc":
            units = _nal_units(container, stream, "hevc_mp4toannexb", _key_h265)
            kind, payload_type, header, describe, payloads = "H265", 96, 3, _sdp_h265(units), payloads_h265
        elif codec == "mjpeg":
            units = _jpegs(container, stream)
            kind, payload_type, header, describe, payloads = "JPEG", 26, 140, "", payloads_jpeg
        else:
            raise ValueError(f"{path}: cannot serve codec {codec}")
    sdp = [f"a=rtpmap:{payload_type} {kind}/{CLOCK_HZ}", f"a=framerate:{float(rate):g}"]
    if describe:
        sdp.append(f"a=fmtp:{payload_type} {describe}")
    lap = units[-1].ticks + round(CLOCK_HZ / rate)
    return Track(tuple(units), lap, payload_type, header, tuple(sdp), payloads)


def _ticks(pts: int | None, first: int, time_base: Fraction | None) -> int:
    assert pts is not None
    assert time_base is not None
    return round((pts - first) * time_base * CLOCK_HZ)


def _nal_units(
    container: InputContainer, stream: VideoStream, to_annex_b: str, key: Callable[[bytes], bool]
) -> list[AccessUnit]:
    units: list[AccessUnit] = []
    first: int | None = None
    bit_filter = BitStreamFilterContext(to_annex_b, stream)
    for packet in container.demux(stream):
        if not packet.size:
            continue
        for out in bit_filter.filter(packet):
            first = out.pts or 0 if first is None else first
            nals = tuple(n for n in _START_CODE.split(bytes(out)) if n)
            units.append(AccessUnit(_ticks(out.pts, first, stream.time_base), any(map(key, nals)), nals))
    return units


def _key_h264(nal: bytes) -> bool:
    return nal[0] & 31 == 5


def _key_h265(nal: bytes) -> bool:
    return 16 <= _type_h265(nal) <= 21


def _type_h265(nal: bytes) -> int:
    return nal[0] >> 1 & 63


def _sdp_h264(units: list[AccessUnit]) -> str:
    sets = {n[0] & 31: n for unit in units for n in unit.parts if n[0] & 31 in (7, 8)}
    coded = ",".join(base64.b64encode(sets[kind]).decode() for kind in (7, 8))
    return f"packetization-mode=1;profile-level-id={sets[7][1:4].hex()};sprop-parameter-sets={coded}"


def _sdp_h265(units: list[AccessUnit]) -> str:
    names = {32: "sprop-vps", 33: "sprop-sps", 34: "sprop-pps"}
    sets = {_type_h265(n): n for unit in units for n in unit.parts if _type_h265(n) in names}
    return ";".join(f"{name}={base64.b64encode(sets[kind]).decode()}" for kind, name in names.items())


def payloads_h264(unit: AccessUnit) -> Iterator[bytes]:
    """Single NAL units, and FU-A fragments of those that are too large."""
    for nal in unit.parts:
        if len(nal) <= MAX_PAYLOAD:
            yield nal
            continue
        indicator, kind = nal[0] & 0xE0 | 28, nal[0] & 31
        for start, chunk, end in _chunks(nal[1:], MAX_PAYLOAD - 2):
            yield bytes([indicator, kind | start << 7 | end << 6]) + chunk


def payloads_h265(unit: AccessUnit) -> Iterator[bytes]:
    """Single NAL units, and fragmentation units (type 49) of those that are too large."""
    for nal in unit.parts:
        if len(nal) <= MAX_PAYLOAD:
            yield nal
            continue
        header = bytes([nal[0] & 0x81 | 49 << 1, nal[1]])
        for start, chunk, end in _chunks(nal[2:], MAX_PAYLOAD - 3):
            yield header + bytes([_type_h265(nal) | start << 7 | end << 6]) + chunk


def _chunks(data: bytes, size: int) -> Iterator[tuple[bool, bytes, bool]]:
    for at in range(0, len(data), size):
        yield at == 0, data[at : at + size], at + size >= len(data)


def _jpegs(container: InputContainer, stream: VideoStream) -> list[AccessUnit]:
    """Re-encode: RFC 2435 sends no Huffman tables, so they must be the default ones, in 4:2:0.

    One slice: several make restart markers, which need a header of their own.
    """
    encoder = av.CodecContext.create("mjpeg", "w")
    encoder.width, encoder.height, encoder.pix_fmt = stream.width, stream.height, "yuvj420p"
    encoder.time_base = Fraction(1, CLOCK_HZ)
    encoder.options = {"huffman": "default", "qmin": "3", "qmax": "3", "slices": "1"}
    units: list[AccessUnit] = []
    first: int | None = None
    for frame in container.decode(stream):
        first = frame.pts or 0 if first is None else first
        ticks = _ticks(frame.pts, first, frame.time_base)
        picture = frame.reformat(format="yuvj420p")
        picture.pts, picture.time_base = ticks, encoder.time_base
        units += [AccessUnit(ticks, True, (bytes(packet),)) for packet in encoder.encode(picture)]
    return units


def payloads_jpeg(unit: AccessUnit) -> Iterator[bytes]:
    """Scan data after the JPEG payload header; the quantisation tables travel in the first packet."""
    (jpeg,) = unit.parts
    tables, width, height, scan = _parse_jpeg(jpeg)
    offset = 0
    while offset < len(scan):
        header = bytes([0]) + offset.to_bytes(3, "big") + bytes([1, 255, width // 8, height // 8])
        if offset == 0:
            header += bytes([0, 0]) + len(tables).to_bytes(2, "big") + tables
        chunk = scan[offset : offset + MAX_PAYLOAD - len(header)]
        offset += len(chunk)
        yield header + chunk


def _parse_jpeg(jpeg: bytes) -> tuple[bytes, int, int, bytes]:
    """Quantisation tables (luma, chroma), width, height and entropy-coded data of a baseline JPEG."""
    tables: dict[int, bytes] = {}
    width = height = 0
    at = 2
    while True:
        marker, size = jpeg[at + 1], int.from_bytes(jpeg[at + 2 : at + 4], "big")
        body = jpeg[at + 4 : at + 2 + size]
        at += 2 + size
        if marker == 0xDB:
            for start in range(0, len(body), 65):
                tables[body[start] & 15] = body[start + 1 : start + 65]
        elif marker == 0xC0:
            height, width = int.from_bytes(body[1:3], "big"), int.from_bytes(body[3:5], "big")
        elif marker == 0xDA:
            luma = tables[0]
            return luma + tables.get(1, luma), width, height, jpeg[at:]
