"""Faults of what the pictures come from: servers, files, and the process that reads them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import pytest

from tests.faults.outside import BLIND_AFTER_S, NOTICED_S
from tests.faults.pictures import (
    RECOVERED_S,
    Course,
    Pictures,
    camera,
    failures,
    row,
    run_fault,
    watching,
    write_clip,
)
from tests.faults.table import Record, Row
from tests.integration.site import wait_for
from tests.servers.process import RtspServer
from tests.service_helpers import HEIGHT, WIDTH

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@dataclass
class Site(Pictures):
    """With the server of the camera `rtsp`."""

    server: RtspServer
    clip: Path
    large: Path
    jpegs: Path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("servers")
    clip, large = write_clip(folder / "clip.mp4"), write_clip(folder / "large.mp4", scale=2)
    jpegs = write_clip(folder / "jpegs.mkv", codec="mjpeg")
    server = RtspServer(clip)
    cameras = {"rtsp": camera("rtsp", server.url), "file": camera("file", str(clip))}
    with watching(folder, cameras, ("rtsp",)) as seen:
        made = Site(seen.daemon, seen.outside, server, clip, large, jpegs)
        yield made
    made.server.kill()


def test_a_file_ends(site: Site, record: Record) -> None:
    """It ended while the others were started; a new camera process reads it once more."""
    outside, counted = site.outside, failures(site, "file", "ended")
    wait_for("end counted", lambda: counted() == 1, 30)
    os.kill(site.daemon.worker("camera", "file"), signal.SIGKILL)
    began = outside.sees("file", time.monotonic()).at_s
    wait_for("second end counted", lambda: counted() == 2, 30)
    time.sleep(BLIND_AFTER_S)
    told = outside.since("file", began)
    last = takewhile(lambda one: one.frame == told[-1].frame, reversed(told))
    ended = list(last)[-1].at_s  # the first process counted its frames from 1 as well
    blind = outside.wait("file", "BLIND", since_s=ended)
    time.sleep(BLIND_AFTER_S)
    assert outside.since("file", began)[-1].at_s > blind.at_s
    outside.never_clear("file", ended, time.monotonic())
    course = Course(blind.at_s - ended, 0.0, outside.lost(site.store, "file"), blind.reason)
    record(
        Row(
            "file ends", "the file in the place of a camera came to its end",
            "BLIND (no_stream), source failure `ended`",
            course.noticed_s, NOTICED_S, course.lost, "stays BLIND until a person gives it another file", None, None,
        )
    )  # fmt: skip


def test_the_server_is_killed(site: Site, record: Record) -> None:
    counted = failures(site, "rtsp", "unreachable")
    before, port = counted(), site.server.port

    def again() -> None:
        site.server = RtspServer(site.clip, port)

    def noticed() -> None:
        wait_for("failure counted", lambda: counted() > before, 20)
        assert "rtsp/apron" in site.daemon.get("/readyz")[1]
        assert site.daemon.get("/livez")[0] == 200

    course = run_fault(site, "rtsp", site.server.kill, noticed, again)
    record(
        row(
            "RTSP server killed",
            "SIGKILL; started again once BLIND was seen",
            "source failures `ended` and `unreachable`",
            "connects by itself",
            course,
        )
    )


def test_the_server_is_stopped(site: Site, record: Record) -> None:
    counted = failures(site, "rtsp", "read_timeout")
    before = counted()
    course = run_fault(
        site,
        "rtsp",
        site.server.stop,
        lambda: wait_for("time-out counted", lambda: counted() > before, 20),
        site.server.cont,
    )
    record(
        row(
            "RTSP server stopped",
            "SIGSTOP: the connection stays open and is silent; SIGCONT once the failure was counted",
            "source failure `read_timeout`",
            "connects by itself",
            course,
        )
    )


def test_the_server_comes_back_with_another_resolution(site: Site, record: Record) -> None:
    port = site.server.port
    counted = failures(site, "rtsp", "size_changed")
    assert counted() == 0

    def again() -> None:
        site.server = RtspServer(site.large, port)

    course = run_fault(site, "rtsp", site.server.kill, end=again)
    wait_for("counted", lambda: counted() == 1, 30)
    frame = site.outside.records["rtsp"][-1]["data"]["objects"]
    assert not frame or frame[0]["x"] < 2 * WIDTH
    record(
        row(
            "resolution changed",
            f"SIGKILL; started again with {2 * WIDTH} x {2 * HEIGHT} px instead of {WIDTH} x {HEIGHT}",
            "source failure `size_changed` at its return",
            "the filter is made anew for the size",
            course,
        )
    )


def test_time_stamps_jump_back_to_zero(site: Site, record: Record) -> None:
    outside = site.outside

    def jumps() -> float:
        return site.metric("lumpwatch_frames_dropped_total", "rtsp", reason="pts_jump")

    before, began = jumps(), time.monotonic()
    outside.sees("rtsp", began)
    site.server.say("zero")
    said = time.monotonic()
    wait_for("jump counted", lambda: jumps() == before + 1, 20)
    noticed = time.monotonic() - said
    outside.raised("rtsp", time.monotonic())
    assert all(one.state != "BLIND" for one in outside.since("rtsp", began))
    record(
        Row(
            "PTS back to 0", "the server counts its time stamps from 0 again, in the same connection",
            "dropped reason `pts_jump` is counted; decisions go on", noticed, 2 * NOTICED_S,
            outside.lost(site.store, "rtsp"), "the clock is anchored anew at the same frame", None, None,
        )
    )  # fmt: skip


def test_time_stamps_stand_still(site: Site, record: Record) -> None:
    """The pictures are good and on time: their arrivals take the place of the stamps."""
    outside, before = site.outside, _clock_faults(site)
    outside.sees("rtsp", time.monotonic())
    site.server.say("hold")
    began = time.monotonic()
    wait_for("told", lambda: _clock_faults(site) > before, 20)
    noticed = time.monotonic() - began
    back = outside.sees("rtsp", time.monotonic())
    for _ in range(2):
        outside.raised("rtsp", time.monotonic())
    assert all(one.state != "BLIND" for one in outside.since("rtsp", back.at_s + 0.5))
    site.server.say("release")
    site.server.say("kick")  # a connection made anew is believed again
    outside.sees("rtsp", time.monotonic())
    record(
        Row(
            "time stamps stand still", "every picture has the stamp of the one before, until two lumps were announced",
            "dropped reason `clock` is counted, a warning in the log", noticed, NOTICED_S,
            outside.lost(site.store, "rtsp"), "pictures count as captured when they arrive, decisions go on",
            back.at_s - began, RECOVERED_S,
        )
    )  # fmt: skip


def test_the_cameras_clock_is_slow(site: Site, record: Record) -> None:
    """It declares ten frames a second and delivers eight."""
    outside, before = site.outside, _clock_faults(site)
    site.server.say("rate 0.8")
    site.server.say("kick")
    began = time.monotonic()
    wait_for("told", lambda: _clock_faults(site) > before, 60)
    noticed = time.monotonic() - began
    assert "its clock runs 20 % slow" in site.daemon.log.read_text()
    for _ in range(2):
        outside.raised("rtsp", time.monotonic())
    assert all(one.state != "BLIND" for one in outside.since("rtsp", began + noticed))
    site.server.say("rate 1")
    site.server.say("kick")
    record(
        Row(
            "wrong frame rate", "the stamps count ten frames a second, eight come",
            "\"its clock runs 20 % slow\" in the log, once; decisions go on", noticed, 30.0,
            outside.lost(site.store, "rtsp"), "nothing to recover from: stamps are put right", None, None,
        )
    )  # fmt: skip


def _clock_faults(site: Site) -> float:
    return site.metric("lumpwatch_frames_dropped_total", "rtsp", reason="clock")


def test_jpegs_are_cut(site: Site, record: Record) -> None:
    """Their missing part must not be shown as an older picture had it."""
    port = site.server.port
    site.server.kill()
    site.server = RtspServer(site.jpegs, port)

    def counted() -> float:
        return site.metric("lumpwatch_frames_dropped_total", "rtsp", reason="corrupt")

    site.outside.raised("rtsp", time.monotonic())
    before = counted()
    course = run_fault(
        site,
        "rtsp",
        lambda: site.server.say("cut 1000000"),
        lambda: wait_for("counted", lambda: counted() > before, 20),
        lambda: site.server.say("cut 0"),
    )
    record(
        row(
            "cut JPEGs",
            "MJPEG over RTSP, each picture without its last tenth",
            "dropped reason `corrupt` is counted",
            "pictures that are whole are shown again",
            course,
        )
    )


def test_the_camera_process_is_killed(site: Site, record: Record) -> None:
    pid = site.daemon.worker("camera", "rtsp")

    def restarts() -> float:
        return site.metric("lumpwatch_worker_restarts_total", "rtsp", process="camera", reason="exited")

    before = restarts()
    course = run_fault(
        site,
        "rtsp",
        lambda: os.kill(pid, signal.SIGKILL),
        lambda: wait_for("restart counted", lambda: restarts() == before + 1, 20),
    )
    record(
        row(
            "camera process killed",
            "SIGKILL",
            "`lumpwatch_worker_restarts_total`",
            "the daemon starts it again after 0.5 s",
            course,
        )
    )


def test_the_camera_process_hangs(site: Site, record: Record) -> None:
    pid = site.daemon.worker("camera", "rtsp")
    course = run_fault(
        site,
        "rtsp",
        lambda: os.kill(pid, signal.SIGSTOP),
        # What the process last said of itself must not stand there as if it were so.
        lambda: wait_for(
            "its gauges are gone",
            lambda: not site.daemon.shows("lumpwatch_source_connected", camera="rtsp"),
            20,
        ),
        lambda: os.kill(pid, signal.SIGCONT),
    )
    record(
        row(
            "camera process hangs",
            "SIGSTOP; SIGCONT once its gauges were gone from the page of metrics",
            "its gauges vanish from the metrics after 3 s",
            "goes on; after 10 s it would be killed and started again",
            course,
        )
    )
