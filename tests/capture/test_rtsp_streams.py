"""RTSP sources against real servers, ours and GStreamer's."""

from __future__ import annotations

import contextlib
import logging
import socket
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import SecretStr

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.reconnect import Reconnecting
from lumpwatch.service.capture.sources.rtsp import RtspSource
from lumpwatch.service.config.source import BackoffConfig, SourceConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.core.video_writer import Codec
from tests.servers.clips import write_clip
from tests.servers.process import GstServer, RtspServer, gst_missing

CODECS: tuple[Codec, ...] = ("h264", "h265", "mjpeg")
FRAMES = 50


class Camera(contextlib.ExitStack):
    """An RtspSource with what it counted."""

    def __init__(self, url: str, encoding: Any = "gray8", **config: Any) -> None:
        super().__init__()
        self.counts: Counter[str] = Counter()
        self.source = RtspSource(
            SourceConfig(url=SecretStr(url), **{"open_timeout_s": 20.0, **config}),
            "c1",
            encoding,
            count=lambda reason: self.counts.update([reason]),
            monotonic=time.monotonic,
            wall=time.time,
        )
        self.callback(self.source.close)

    def opened(self) -> Camera:
        self.source.open()
        return self

    def read(self, count: int) -> list[Frame]:
        return [self.source.read() for _ in range(count)]

    def fault(self) -> SourceError:
        """Open and read until it fails."""
        with pytest.raises(SourceError) as caught:
            read_on(self.opened().source)
        return caught.value

    def refused(self, deadline_s: float = 20.0) -> SourceError:
        """Open again and again until it fails: the server may not have heard yet that it shall."""
        end = time.monotonic() + deadline_s
        while time.monotonic() < end:
            try:
                self.source.open()
            except SourceError as error:
                return error
        pytest.fail("it was never refused")

    def breaks(self) -> SourceError:
        """Read on until it fails."""
        with pytest.raises(SourceError) as caught:
            read_on(self.source)
        return caught.value


def read_on(source: RtspSource, deadline_s: float = 60.0) -> None:
    end = time.monotonic() + deadline_s
    while time.monotonic() < end:
        source.read()


def number(frame: Frame) -> int:
    return round(float(frame.data[:16, :16].mean()) / 4)


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> dict[Codec, Path]:
    """Two seconds each, a key frame every 0.4 s."""
    folder = tmp_path_factory.mktemp("clips")
    return {c: write_clip(folder / f"{c}.mp4", codec=c, frames=FRAMES, gop=10) for c in CODECS}


@pytest.fixture
def server(clips: dict[Codec, Path]) -> Iterator[RtspServer]:
    with RtspServer(clips["h264"]) as server:
        yield server


def check_frames(frames: list[Frame]) -> None:
    assert [f.seq for f in frames] == list(range(len(frames)))
    for a, b in pairwise(frames):
        assert (number(b) - number(a)) % FRAMES == 1
        assert a.capture_s <= b.capture_s <= b.received_s
    # The first frames come at once, from probing; the later ones have their own times.
    gaps = [b.capture_s - a.capture_s for a, b in pairwise(frames[-20:])]
    assert gaps == pytest.approx([0.04] * 19, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize("codec", CODECS)
def test_frames_of_our_server(clips: dict[Codec, Path], codec: Codec, transport: str) -> None:
    with RtspServer(clips[codec]) as server, Camera(server.url, transport=transport).opened() as camera:
        frames = camera.read(70)
        check_frames(frames)
        assert (frames[0].width, frames[0].height, frames[0].data.shape) == (96, 64, (64, 96))
        assert camera.source.nominal_fps == 25.0
        assert camera.source.length is None
        assert camera.counts == {}


@pytest.mark.slow
@pytest.mark.system
@pytest.mark.parametrize("codec", CODECS)
def test_frames_of_a_gstreamer_server(clips: dict[Codec, Path], codec: Codec) -> None:
    if reason := gst_missing():
        pytest.skip(reason)
    with GstServer(clips[codec], codec) as server, Camera(server.url, encoding="i420").opened() as camera:
        frames = camera.read(40)
        assert frames[0].data.shape == (96, 96)
        gaps = [b.capture_s - a.capture_s for a, b in pairwise(frames[-20:])]
        assert gaps == pytest.approx([0.04] * 19, abs=0.01)
        # It plays the file once, then says goodbye.
        assert camera.breaks().fault is Fault.ENDED


@pytest.mark.slow
@pytest.mark.parametrize("how", ["freeze", "stop"])
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_stream_that_falls_silent(server: RtspServer, how: str, transport: str) -> None:
    with Camera(server.url, transport=transport, read_timeout_s=3.0).opened() as camera:
        camera.read(30)
        started = time.monotonic()
        server.say("freeze") if how == "freeze" else server.stop()
        # A server that stops in the middle of a picture leaves it damaged, which may be what is seen last.
        cut_off = {Fault.CORRUPT} if (how, transport) == ("stop", "udp") else set()
        assert camera.breaks().fault in {Fault.READ_TIMEOUT} | cut_off
        # FFmpeg alone, given 3 s, would take 6.
        assert 2.5 <= time.monotonic() - started <= 5.5
        server.cont()


@pytest.mark.slow
def test_time_spent_by_the_reader_is_not_held_against_the_stream(server: RtspServer) -> None:
    with Camera(server.url, read_timeout_s=1.0, max_age_s=60.0).opened() as camera:
        camera.read(5)
        time.sleep(2.0)
        camera.read(60)
        assert camera.counts == {}


@pytest.mark.slow
def test_frames_that_come_late_are_dropped_until_it_is_up_to_date(server: RtspServer) -> None:
    with Camera(server.url, max_age_s=0.5, read_timeout_s=20.0).opened() as camera:
        before = camera.read(30)[-1]
        server.stop()
        time.sleep(2.0)
        server.cont()
        after = camera.read(30)
        assert camera.counts["stale"] > 10
        assert all(f.received_s - f.capture_s <= 0.5 for f in after)
        assert [f.seq for f in after] == list(range(before.seq + 1, before.seq + 31))


@pytest.mark.slow
@pytest.mark.parametrize("codec", CODECS)
def test_damaged_packets_are_counted_and_the_stream_goes_on(clips: dict[Codec, Path], codec: Codec) -> None:
    with RtspServer(clips[codec]) as server, Camera(server.url, read_timeout_s=20.0).opened() as camera:
        camera.read(20)
        server.say("corrupt 8")
        camera.read(50)
        assert camera.counts["corrupt"] >= 1


def test_jpegs_that_the_camera_itself_cut_are_refused(clips: dict[Codec, Path]) -> None:
    """Else their missing part would be shown as the picture before had it."""
    with RtspServer(clips["mjpeg"]) as server, Camera(server.url, read_timeout_s=20.0).opened() as camera:
        camera.read(10)
        assert camera.counts == {}
        server.say("cut 8")
        camera.read(30)
        assert camera.counts == {"corrupt": 8}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "encoding"), [("Förderband Süd", "latin-1"), ("破碎机", "gbk")])
def test_a_session_whose_name_is_not_utf_8(clips: dict[Codec, Path], name: str, encoding: str) -> None:
    with (
        RtspServer(clips["h264"], more=("--name", name, "--encoding", encoding)) as server,
        Camera(server.url).opened() as camera,
    ):
        assert len(camera.read(3)) == 3
        assert camera.counts == {}


@pytest.mark.slow
@pytest.mark.parametrize("codec", ["h264", "h265"])
def test_a_stream_of_damage_only(clips: dict[Codec, Path], codec: Codec) -> None:
    with RtspServer(clips[codec]) as server, Camera(server.url, read_timeout_s=2.0).opened() as camera:
        camera.read(5)
        server.say("corrupt 100000")
        assert camera.breaks().fault is Fault.CORRUPT


@pytest.mark.slow
@pytest.mark.parametrize("timeout_s", [1.0, 5.0])
def test_time_stamps_that_stand_still(server: RtspServer, timeout_s: float) -> None:
    """They give way to arrivals before the stream would count as dead, however soon that is."""
    with Camera(server.url, read_timeout_s=timeout_s).opened() as camera:
        camera.read(20)
        server.say("hold")
        frames = camera.read(25)
        assert camera.counts["clock"] == 1
        assert camera.counts["frozen_pts"] > 5
        assert all(one.capture_s == one.received_s for one in frames[-5:])


@pytest.mark.slow
def test_time_stamps_that_jump_back_are_counted(server: RtspServer) -> None:
    with Camera(server.url).opened() as camera:
        frames = camera.read(30)
        server.say("back 30")
        frames += camera.read(30)
        assert camera.counts == {"pts_jump": 1}
        assert all(a.capture_s <= b.capture_s <= b.received_s for a, b in pairwise(frames))


def test_faults_of_opening(clips: dict[Codec, Path]) -> None:
    with RtspServer(clips["h264"], user="eye", password="geheim@1/2") as server:
        address = server.url.removeprefix("rtsp://")
        assert Camera(server.url).fault().fault is Fault.UNAUTHORISED
        assert Camera(f"rtsp://eye:geheim@{address}").fault().fault is Fault.UNAUTHORISED
        good = f"rtsp://eye:{quote('geheim@1/2', safe='')}@{address}"
        assert Camera(good + "era").fault().fault is Fault.NOT_FOUND
        server.say("refuse")
        refused = Camera(good).refused()
        assert str(refused).startswith(f"camera c1: rtsp://***@{address}: ")
        server.kill()
        gone = Camera(good).fault()
        assert gone.fault is Fault.UNREACHABLE
        assert str(gone).startswith(f"camera c1: rtsp://***@{address}: ")


@pytest.mark.slow
def test_a_server_that_does_not_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        started = time.monotonic()
        url = f"rtsp://127.0.0.1:{deaf.getsockname()[1]}/cam"
        assert Camera(url, open_timeout_s=2.0).fault().fault is Fault.OPEN_TIMEOUT
        assert time.monotonic() - started <= 4.0


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_server_that_is_killed_and_comes_back(
    clips: dict[Codec, Path], tmp_path: Path, transport: str
) -> None:
    events: list[str] = []

    class Log:
        def attempt(self) -> None:
            events.append("attempt")

        def connected(self) -> None:
            events.append("connected")

        def failed(self, fault: Fault) -> None:
            events.append(f"failed {fault}")

        def dropped(self, reason: Fault) -> None:
            events.append("dropped")

    larger = write_clip(tmp_path / "larger.mp4", width=128, gop=10)
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(RtspServer(clips["h264"]))
        pauses: list[float] = []

        def pause(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 2:
                stack.enter_context(RtspServer(larger, first.port))

        camera = stack.enter_context(Camera(first.url, transport=transport))
        backoff = BackoffConfig(initial_s=0.1, max_s=1.0, jitter=0.0)
        stream = Reconnecting(camera.source, backoff, Event(), Log(), np.random.default_rng(1), pause)
        frames = [stream.read() for _ in range(10)]
        first.kill()
        while (frame := stream.read()) and frame.width == 96:
            frames.append(frame)
        frames.append(frame)
        frames += [stream.read() for _ in range(10)]
        stream.close()
    got = [f for f in frames if f]
    assert [f.seq for f in got] == list(range(len(frames)))
    assert all(a.capture_s <= b.capture_s <= b.received_s for a, b in pairwise(got))
    assert pauses == [0.1, 0.2, 0.4]
    assert events == [
        "attempt", "connected", "dropped", "attempt", "failed unreachable", "attempt", "failed size_changed",
        "attempt", "connected",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_connection_that_the_server_closes(server: RtspServer) -> None:
    with Camera(server.url).opened() as camera:
        camera.read(5)
        server.say("kick")
        assert camera.breaks().fault is Fault.ENDED


def closed_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    secret=st.text(st.characters(min_codepoint=33, max_codepoint=0x2FF), max_size=12), encode=st.booleans()
)
def test_no_secret_gets_out(caplog: pytest.LogCaptureFixture, secret: str, encode: bool) -> None:
    password = "geheim" + secret
    # Unencoded, these end the part of a URL that can hold a password.
    written = quote(password, safe="") if encode else "".join(c for c in password if c not in "/?#[]@%")
    camera = Camera(f"rtsp://benutzer:{written}@127.0.0.1:{closed_port()}/cam")
    caplog.clear()
    with caplog.at_level(logging.DEBUG):
        error = camera.fault()
        logging.getLogger(__name__).error("failed", exc_info=error)
    assert error.__cause__ is None
    assert error.__context__ is None
    told = [str(error), repr(error), repr(camera.source), caplog.text, *traceback.format_exception(error)]
    for text in told:
        assert "geheim" not in text
        assert "benutzer" not in text
