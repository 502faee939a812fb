from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from pydantic import SecretStr

from lumpwatch.service.capture.sources.base import Fault, Source, SourceError
from lumpwatch.service.capture.sources.make import make_source
from lumpwatch.service.config.source import SourceConfig
from lumpwatch.service.core.frame import Frame
from tests.servers.clips import write_clip

FPS = 10.0


class Clock:
    """Monotonic and wall clock that only sleeping and `advance` move."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.slept = 0.0

    def monotonic(self) -> float:
        return self.now

    def wall(self) -> float:
        return self.now + 1e9

    def sleep(self, pause: float) -> None:
        self.now += pause
        self.slept += pause


class Player:
    def __init__(self, path: Path, encoding: Any = "gray8", **config: Any) -> None:
        self.clock = Clock()
        self.counts: Counter[str] = Counter()
        self.source: Source = make_source(
            SourceConfig(url=SecretStr(str(path)), **config),
            "c1",
            encoding,
            count=lambda reason: self.counts.update([reason]),
            monotonic=self.clock.monotonic,
            wall=self.clock.wall,
            sleep=self.clock.sleep,
        )

    def frames(self) -> Iterator[Frame]:
        self.source.open()
        while frame := self.source.read():
            yield frame

    def fault(self) -> SourceError:
        with pytest.raises(SourceError) as caught:
            list(self.frames())
        self.source.close()
        assert "\n" not in str(caught.value)
        return caught.value


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty frames, two seconds, a key frame every half second."""
    return write_clip(tmp_path_factory.mktemp("clips") / "clip.mp4", frames=20, fps=FPS, gop=5)


def number(frame: Frame) -> int:
    """Which frame of the clip it is."""
    return round(float(frame.data[:16, :16].mean()) / 4)


def collect(player: Player, into: list[Frame]) -> None:
    for frame in player.frames():
        into.append(frame)  # noqa: PERF402  the frames before an error count


def remux(clip: Path, target: Path, **options: str) -> Path:
    """The packets of the clip in another container, or with its index in front."""
    with av.open(str(clip)) as source, av.open(str(target), "w", options=options) as sink:
        stream = source.streams.video[0]
        out = sink.add_stream_from_template(stream)
        for packet in source.demux(stream):
            if packet.size:
                packet.stream = out
                sink.mux(packet)
    return target


def test_a_paced_file_plays_at_its_own_speed(clip: Path) -> None:
    player = Player(clip)
    frames = list(player.frames())
    assert [f.seq for f in frames] == list(range(20))
    assert [number(f) for f in frames] == list(range(20))
    assert [f.capture_s for f in frames] == pytest.approx([1000.0 + i / FPS for i in range(20)])
    assert [f.received_s for f in frames] == pytest.approx([f.capture_s for f in frames])
    assert frames[3].wall_s == pytest.approx(1e9 + 1000.3)
    assert player.clock.slept == pytest.approx(1.9)
    assert (frames[0].width, frames[0].height, frames[0].encoding) == (96, 64, "gray8")
    assert frames[0].data.shape == (64, 96)


def test_without_pacing_it_does_not_wait_and_carries_media_time(clip: Path) -> None:
    player = Player(clip, pace=False)
    frames = list(player.frames())
    assert player.clock.slept == 0.0
    assert [f.capture_s for f in frames] == pytest.approx([1000.0 + i / FPS for i in range(20)])
    assert [f.received_s for f in frames] == [f.capture_s for f in frames]


def test_a_slow_reader_makes_a_paced_file_play_later(clip: Path) -> None:
    player = Player(clip, max_age_s=0.5)
    frames = []
    for frame in player.frames():
        frames.append(frame)
        if frame.seq == 4:
            player.clock.now += 3.0
    assert len(frames) == 20
    assert player.counts == {"slipped": 1}
    assert frames[5].capture_s == pytest.approx(1003.4)
    assert frames[6].capture_s - frames[5].capture_s == pytest.approx(0.1)


def test_a_reader_a_little_late_gets_frames_at_once_with_their_true_capture(clip: Path) -> None:
    player = Player(clip, max_age_s=0.5)
    frames = []
    for frame in player.frames():
        frames.append(frame)
        if frame.seq == 4:
            player.clock.now += 0.25
    late = [round(f.received_s - f.capture_s, 6) for f in frames]
    assert late[5:8] == [0.15, 0.05, 0.0]
    assert player.counts == {}


def test_a_loop_goes_on_smoothly(clip: Path) -> None:
    player = Player(clip, loop=True)
    frames = [f for f, _ in zip(player.frames(), range(50), strict=False)]
    assert [number(f) for f in frames[18:22]] == [18, 19, 0, 1]
    assert [b.capture_s - a.capture_s for a, b in pairwise(frames)] == pytest.approx([0.1] * 49)
    assert [f.seq for f in frames] == list(range(50))
    assert player.source.length is None
    assert player.counts == {}


def test_start_between_key_frames(clip: Path) -> None:
    player = Player(clip, start_s=0.7)
    frames = player.frames()
    first = next(frames)
    assert number(first) == 7
    assert first.capture_s == 1000.0
    assert player.source.length == 13
    assert len(list(frames)) == 12


def test_start_past_the_end(clip: Path) -> None:
    assert Player(clip, start_s=60.0, loop=True).fault().fault is Fault.EMPTY


def test_rate_and_length_are_known_while_it_is_open(clip: Path) -> None:
    source = Player(clip).source
    assert (source.nominal_fps, source.length) == (None, None)
    source.open()
    assert (source.nominal_fps, source.length) == (FPS, 20)
    source.close()
    source.close()
    assert source.nominal_fps is None


def test_numbers_go_on_when_opened_again(clip: Path) -> None:
    player = Player(clip)
    first, second = list(player.frames()), list(player.frames())
    assert [f.seq for f in first + second] == list(range(40))
    assert second[0].capture_s >= first[-1].capture_s


@pytest.mark.parametrize("codec", ["h265", "mjpeg"])
def test_other_codecs_and_colour(tmp_path: Path, codec: Any) -> None:
    clip = write_clip(tmp_path / "clip.mkv", codec=codec, frames=4)
    frames = list(Player(clip, encoding="i420", pace=False).frames())
    assert [number(f) for f in frames] == [0, 1, 2, 3]
    assert frames[0].data.shape == (96, 96)
    assert (frames[0].height, frames[0].encoding) == (64, "i420")


def test_a_file_that_changed_its_size_is_counted_once(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "clip.mp4", frames=2)
    player = Player(path)
    list(player.frames())
    write_clip(path, frames=2, width=128)
    assert [f.width for f in player.frames()] == [128, 128]
    assert player.counts[Fault.SIZE_CHANGED] == 1


def test_files_that_are_no_video(tmp_path: Path, clip: Path) -> None:
    def fault(name: str, content: bytes | None = None) -> Fault:
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        error = Player(path).fault()
        assert str(path) in str(error)
        return error.fault

    assert fault("missing.mp4") is Fault.NOT_FOUND
    assert fault("missing/clip.mp4") is Fault.NOT_FOUND
    assert fault("empty.mp4", b"") is Fault.EMPTY
    assert fault("text.mp4", b"no video at all\n" * 50) is Fault.CORRUPT
    assert fault("cut_before_its_index.mp4", clip.read_bytes()[:4000]) is Fault.CORRUPT


def test_text_is_not_drawn_as_a_film(tmp_path: Path) -> None:
    """Labels in the place of the video: FFmpeg makes pictures of their letters."""
    (tmp_path / "gt.txt").write_text("1,1,10,20,30,40\n" * 50)
    error = Player(tmp_path / "gt.txt").fault()
    assert error.fault is Fault.CODEC
    assert str(error).endswith("gt.txt: is text, not a video")


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "folder" / "1.png")
    for path in (tmp_path / "pipe.mp4", Path("/dev/zero"), tmp_path / "folder"):
        error = Player(path).fault()
        assert error.fault is Fault.CODEC
        assert "pipe, socket or device" in str(error)


def test_of_several_streams_the_film_is_shown(tmp_path: Path) -> None:
    """A preview and a cover picture stand before it, as recorders and phones write them."""
    path = tmp_path / "several.mkv"
    with av.open(str(path), "w") as container:
        streams = [container.add_stream("ffv1", rate=10) for _ in range(2)]
        for stream, side in zip(streams, (16, 64), strict=True):
            stream.width = stream.height = side
            stream.pix_fmt = "yuv420p"
        for index in range(6):
            for stream in streams:
                picture = np.full((stream.height, stream.width, 3), 40 * index, np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        for stream in streams:
            container.mux(stream.encode(None))
    assert [frame.width for frame in Player(path).frames()] == [64] * 6


def test_a_path_with_odd_characters(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a: odd %03d näme#1?.mp4", frames=3)
    assert len(list(Player(path).frames())) == 3


def test_a_folder_that_appeared_where_a_file_was_named(tmp_path: Path) -> None:
    player = Player(tmp_path / "later")
    (tmp_path / "later").mkdir()
    assert player.fault().fault is Fault.CODEC


def test_a_file_without_permission(clip: Path, tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(clip.read_bytes())
    path.chmod(0)
    player = Player(path)
    user = os.geteuid()
    try:
        if user == 0:
            os.seteuid(65534)  # root may read everything
        assert player.fault().fault is Fault.NO_PERMISSION
    finally:
        os.seteuid(user)


def test_a_file_of_sound_only(tmp_path: Path) -> None:
    path = tmp_path / "sound.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    error = Player(path).fault()
    assert error.fault is Fault.CODEC
    assert "no video stream" in str(error)


def test_a_codec_that_nothing_decodes(tmp_path: Path, clip: Path) -> None:
    path = tmp_path / "unknown.mp4"
    path.write_bytes(clip.read_bytes().replace(b"avc1", b"zzz9").replace(b"avcC", b"free"))
    assert Player(path).fault().fault is Fault.CODEC


@pytest.mark.parametrize("share", [0.45, 0.6, 0.8])
def test_a_cut_off_mp4_gives_its_frames_and_then_says_so(clip: Path, tmp_path: Path, share: float) -> None:
    whole = remux(clip, tmp_path / "whole.mp4", movflags="faststart")
    data = whole.read_bytes()
    path = tmp_path / "cut.mp4"
    path.write_bytes(data[: int(len(data) * share)])
    frames: list[Frame] = []
    with pytest.raises(SourceError) as caught:
        collect(Player(path), frames)
    assert caught.value.fault is Fault.CORRUPT
    assert str(path) in str(caught.value)
    assert 0 < len(frames) < 20
    assert [number(f) for f in frames] == list(range(len(frames)))
    assert len(list(Player(whole).frames())) == 20


def test_a_cut_off_matroska_file_ends_with_the_frames_it_has(clip: Path, tmp_path: Path) -> None:
    whole = remux(clip, tmp_path / "whole.mkv")
    data = whole.read_bytes()
    path = tmp_path / "cut.mkv"
    path.write_bytes(data[: len(data) * 2 // 3])
    assert 0 < len(list(Player(path).frames())) < 20


def test_damage_in_the_middle_is_counted_and_passed_over(clip: Path, tmp_path: Path) -> None:
    data = bytearray(clip.read_bytes())
    start = data.index(b"mdat") + 4
    middle = start + 5000
    assert middle + 1500 < len(data)
    data[middle : middle + 1500] = bytes(1500)
    path = tmp_path / "damaged.mp4"
    path.write_bytes(data)
    player = Player(path)
    frames = list(player.frames())
    assert player.counts["corrupt"] >= 1
    assert 10 <= len(frames) < 20
    assert number(frames[-1]) == 19


def write_pictures(folder: Path, names: list[str], suffix: str = ".png") -> None:
    folder.mkdir(exist_ok=True)
    for i, name in enumerate(names):
        picture = np.full((64, 96), 4 * i, np.uint8)
        assert cv2.imwrite(str(folder / (name + suffix)), picture)


def test_images_come_in_natural_order_at_ten_a_second(tmp_path: Path) -> None:
    write_pictures(tmp_path / "p", ["img1", "img2", "img9", "img10", "img100"])
    (tmp_path / "p" / "notes.txt").write_text("not a picture")
    player = Player(tmp_path / "p")
    frames = list(player.frames())
    assert [number(f) for f in frames] == [0, 1, 2, 3, 4]
    assert [f.capture_s for f in frames] == pytest.approx([1000.0, 1000.1, 1000.2, 1000.3, 1000.4])
    assert (player.source.nominal_fps, player.source.length) == (10.0, 5)


@pytest.mark.parametrize("suffix", [".jpg", ".bmp", ".tiff", ".webp"])
def test_image_formats(tmp_path: Path, suffix: str) -> None:
    write_pictures(tmp_path / "p", ["1", "2"], suffix)
    frames = list(Player(tmp_path / "p", encoding="i420", pace=False, fps=2.0).frames())
    assert [number(f) for f in frames] == [0, 1]
    assert frames[1].capture_s - frames[0].capture_s == 0.5


def test_images_loop_and_start_later(tmp_path: Path) -> None:
    write_pictures(tmp_path / "p", ["1", "2", "3"])
    player = Player(tmp_path / "p", loop=True, start_s=0.1)
    frames = [f for f, _ in zip(player.frames(), range(5), strict=False)]
    assert [number(f) for f in frames] == [1, 2, 1, 2, 1]
    assert [b.capture_s - a.capture_s for a, b in pairwise(frames)] == pytest.approx([0.1] * 4)


def test_an_image_of_another_size_is_counted_and_one_that_is_damaged_named(tmp_path: Path) -> None:
    write_pictures(tmp_path / "p", ["1", "2"])
    assert cv2.imwrite(str(tmp_path / "p" / "3.png"), np.zeros((32, 96), np.uint8))
    player = Player(tmp_path / "p")
    assert [f.height for f in player.frames()][-1] == 32
    assert player.counts[Fault.SIZE_CHANGED] == 1
    (tmp_path / "p" / "2.png").write_bytes(b"damaged")
    error = Player(tmp_path / "p").fault()
    assert (error.fault, "2.png" in str(error)) == (Fault.CORRUPT, True)


def test_folders_that_hold_nothing_or_are_gone(tmp_path: Path) -> None:
    folder = tmp_path / "p"
    folder.mkdir()
    player = Player(folder)
    assert player.fault().fault is Fault.EMPTY
    folder.rmdir()
    assert player.fault().fault is Fault.NOT_FOUND


def test_reading_what_is_not_open_is_a_mistake(clip: Path, tmp_path: Path) -> None:
    for path in (clip, tmp_path):
        with pytest.raises(RuntimeError):
            Player(path).source.read()


def test_the_simulated_feed_is_made_by_its_url() -> None:
    source = make_source(SourceConfig(url=SecretStr("sim:feed")), "c1", "gray8", count=lambda _: None)
    assert type(source).__name__ == "SimulatedSource"
