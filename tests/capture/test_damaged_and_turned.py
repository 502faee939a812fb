"""What a decoder gives is not believed: cut JPEGs, pictures that lie on their side, combs, sizes that change."""

from __future__ import annotations

import struct
from collections import Counter
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.video.stream import VideoStream
from numpy.typing import NDArray

from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.turning import one_field, turned, turned_i420
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame
from tests.service_helpers import camera

W, H = 96, 64


def shown(k: int, width: int = W, height: int = H) -> NDArray[np.uint8]:
    """Noise with a bright spot at the upper left, so that every turn looks different."""
    picture = np.random.default_rng(k).integers(40, 90, (height, width)).astype(np.uint8)
    picture[4:20, 4:28] = 230
    return picture


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".jpg", picture)[1].tobytes()


def mjpeg(path: Path, pictures: list[bytes], size: tuple[int, int] = (W, H)) -> Path:
    """The JPEGs as they are, one frame each."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = *size, "yuvj420p"
        for k, content in enumerate(pictures):
            packet = av.Packet(content)
            packet.time_base, packet.stream = Fraction(1, 25), stream
            packet.pts = packet.dts = k
            packet.is_keyframe = True
            out.mux(packet)
    return path


def film(path: Path, pictures: list[NDArray[np.uint8]], codec: str = "libx264") -> Path:
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=25)
        assert isinstance(stream, VideoStream)
        stream.height, stream.width = pictures[0].shape
        stream.pix_fmt = "yuvj420p" if codec == "libx264" else "yuv420p"
        for picture in pictures:
            made = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format=stream.pix_fmt)
            for packet in stream.encode(made):
                out.mux(packet)
        for packet in stream.encode():
            out.mux(packet)
    return path


def read(path: Path, config: CameraConfig | None = None) -> tuple[list[Frame], Counter[str]]:
    counts: Counter[str] = Counter()
    frames, _ = read_frames(config or camera(), path, lambda reason: counts.update([reason]))
    return list(frames), counts


def test_cut_jpegs_are_no_pictures(tmp_path: Path) -> None:
    whole = [jpeg(shown(k)) for k in range(12)]
    damaged = [content[: len(content) // 2] if k % 3 == 1 else content for k, content in enumerate(whole)]
    frames, counts = read(mjpeg(tmp_path / "cut.mkv", damaged))
    assert (len(frames), counts) == (8, {"corrupt": 4})
    frames, counts = read(mjpeg(tmp_path / "whole.mkv", whole))
    assert (len(frames), counts) == (12, {})


def test_a_codec_that_says_nothing_of_what_follows_damage_waits_for_a_key_frame(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mkv", [shown(0)] * 24, "mpeg2video")
    with av.open(str(path)) as source, av.open(str(tmp_path / "b.mkv"), "w") as out:
        stream = source.streams.video[0]
        target = out.add_stream_from_template(stream)
        keys = []
        for k, packet in enumerate(one for one in source.demux(stream) if one.size):
            keys += [k] if packet.is_keyframe else []
            content = bytes(packet)
            made = av.Packet(content[: len(content) // 2] if k == 3 else content)
            made.pts, made.dts, made.time_base = packet.pts, packet.dts, packet.time_base
            made.is_keyframe, made.stream = packet.is_keyframe, target
            out.mux(made)
    frames, counts = read(tmp_path / "b.mkv")
    following = next(k for k in keys if k > 3)
    assert counts["corrupt"] == following - 3
    assert len(frames) == 24 - (following - 3)


def test_a_cut_photograph_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").write_bytes(jpeg(shown(1)))
    (tmp_path / "2.jpg").write_bytes(jpeg(shown(2))[:900])
    with pytest.raises(SourceError, match=r"2\.jpg") as refused:
        read(tmp_path)
    assert refused.value.fault is Fault.CORRUPT


MATRICES = {
    "quarter": (0, 1, -1, 0),
    "half": (-1, 0, 0, -1),
    "three": (0, -1, 1, 0),
    "mirror": (-1, 0, 0, 1),
    "flip": (1, 0, 0, -1),
}
AS_SEEN = {
    "quarter": lambda picture: np.rot90(picture, -1),
    "half": lambda picture: np.rot90(picture, 2),
    "three": lambda picture: np.rot90(picture, 1),
    "mirror": np.fliplr,
    "flip": np.flipud,
}
EXIF = {"mirror": 2, "half": 3, "flip": 4, "quarter": 6, "three": 8}


@pytest.mark.parametrize("turn", MATRICES)
@pytest.mark.parametrize("colour", [False, True])
def test_a_film_is_turned_as_players_turn_it(tmp_path: Path, turn: str, colour: bool) -> None:
    path = film(tmp_path / "a.mp4", [shown(1)] * 3)
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 4 + 20 + 16
    a, b, c, d = (value * 65536 for value in MATRICES[turn])
    content[at : at + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    upright, _ = read(path)
    path.write_bytes(content)
    config = camera(likelihood={"kind": "histogram", "channel": "colour"}) if colour else camera()
    frames, _ = read(path, config)
    seen = AS_SEEN[turn](upright[0].data)
    assert (frames[0].height, frames[0].width) == seen.shape
    assert np.array_equal(frames[0].data[: frames[0].height], seen)


@pytest.mark.parametrize("turn", EXIF)
@pytest.mark.parametrize("order", [">", "<"])
def test_a_photograph_is_turned_as_its_exif_asks(tmp_path: Path, turn: str, order: str) -> None:
    plain, tagged = tmp_path / "plain", tmp_path / "tagged"
    plain.mkdir()
    tagged.mkdir()
    content = jpeg(shown(1))
    (plain / "1.jpg").write_bytes(content)
    head = b"MM" if order == ">" else b"II"
    tiff = (
        head
        + struct.pack(order + "HIH", 42, 8, 1)
        + struct.pack(order + "HHIHHI", 0x112, 3, 1, EXIF[turn], 0, 0)
    )
    block = b"Exif\0\0" + tiff
    (tagged / "1.jpg").write_bytes(
        content[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + content[2:]
    )
    assert np.array_equal(read(tagged)[0][0].data, AS_SEEN[turn](read(plain)[0][0].data))


def test_planes_are_turned_together() -> None:
    packed = np.arange(6 * 8 * 3 // 2, dtype=np.uint8).reshape(9, 8)
    seen = turned_i420(packed, MATRICES["quarter"])
    assert seen.shape == (12, 6)
    assert np.array_equal(seen[:8], np.rot90(packed[:6], -1))
    blue = packed[6:].reshape(2, 3, 4)[0]
    assert np.array_equal(seen[8:].reshape(2, 4, 3)[0], np.rot90(blue, -1))
    assert np.array_equal(turned(packed, (1, 0, 0, 1)), packed)


@pytest.mark.parametrize("height", [6, 7])
def test_a_comb_is_combed_out(height: int) -> None:
    still = np.tile(np.arange(height, dtype=np.uint8)[:, None] * 10, (1, 4))
    comb = still.copy()
    comb[1::2] = 255  # the other field saw something else
    seen = one_field(comb)
    assert np.array_equal(seen[::2], still[::2])
    inner = slice(1, height - 1, 2)
    assert np.array_equal(seen[inner], still[inner])
    assert seen.max() < 255


def test_a_size_that_changes_in_a_file_is_counted_and_read_on(tmp_path: Path) -> None:
    contents = [jpeg(shown(k)) for k in range(5)] + [jpeg(shown(k, 48, 32)) for k in range(5)]
    frames, counts = read(mjpeg(tmp_path / "a.mkv", contents))
    assert [(frame.width, frame.height) for frame in frames] == [(W, H)] * 5 + [(48, 32)] * 5
    assert counts == {"size_changed": 1}
