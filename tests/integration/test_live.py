from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from tests.integration.conftest import PRIOR
from tests.integration.site import AlarmFollower, Daemon, wait_for
from tests.servers.process import RtspServer

pytestmark = pytest.mark.slow


def camera(name: str, url: str, polygon: str, extra: str = "") -> str:
    return f"""\
  - id: {name}
    source: {{url: "{url}", read_timeout_s: 2.0, open_timeout_s: 4.0, backoff: {{initial_s: 0.2, max_s: 1.0}}{extra}}}
    blind_after_s: 2.0
    rois:
      - id: apron
        polygon: {polygon}
        alarm: {{latch: false}}
"""


def test_alarm_over_rtsp(tmp_path: Path, feed_clip: Path, polygon: str) -> None:
    with RtspServer(feed_clip) as server:
        daemon = Daemon(tmp_path, camera("crusher-1", server.url, polygon))
        imported = daemon.command(
            "priors", "import", str(daemon.config), str(PRIOR), "--camera", "crusher-1", "--roi", "apron"
        )
        assert imported.returncode == 0, imported.stderr
        with daemon, AlarmFollower(daemon.config, tmp_path / "alarms.log") as follower:
            wait_for("ready", lambda: daemon.ready, 60)
            wait_for("prior in metrics", lambda: daemon.metric("lumpwatch_prior_version") == 1, 30)
            record = wait_for("alarm", follower.records, 60)[0]
            assert record["type"] == "io.lumpwatch.alarm.raised.v1"
            assert record["data"]["existence"] > 0.9
            assert (record["data"]["camera"], record["data"]["roi"]) == ("crusher-1", "apron")
            box = record["data"]["objects"][0]
            assert box["w"] > 40
            assert box["model"] in ("belt", "fall")
            code, seconds = daemon.stop()
            assert code == 0
            assert seconds < 5.0
    assert "Traceback" not in daemon.log.read_text()


def test_a_dead_camera_and_killed_workers_do_not_touch_the_other_camera(
    tmp_path: Path, feed_clip: Path, polygon: str
) -> None:
    cameras = camera("good", str(feed_clip), polygon, ", loop: true") + camera(
        "dead", "rtsp://user:geheim@127.0.0.1:9/stream", polygon
    )
    with Daemon(tmp_path, cameras) as daemon:

        def frames() -> float:
            return daemon.metric("lumpwatch_frames_processed_total", camera="good")

        wait_for("good camera decides", lambda: frames() > 30, 60)
        assert daemon.get("/readyz")[0] == 503
        assert "dead/apron" in daemon.get("/readyz")[1]

        def in_pace() -> bool:
            before, began = frames(), time.monotonic()
            time.sleep(3)
            return (frames() - before) / (time.monotonic() - began) > 10  # of 15

        # A machine that is busy with something else for a moment is no failure.
        wait_for("good camera decides at its pace", in_pace, 60)

        for role in ("camera", "monitor"):
            pids = daemon.children()[role]
            assert len(pids) == 2
            for pid in pids:
                os.kill(pid, signal.SIGKILL)

            def again(role: str = role) -> bool:
                return daemon.metric("lumpwatch_worker_restarts_total", process=role, reason="exited") == 2

            wait_for(f"{role}s started again", again, 20)

            def on(least: float = frames() + 30) -> bool:
                return frames() > least

            wait_for("good camera decides on", on, 60)
        code, seconds = daemon.stop()
        assert code == 0
        assert seconds < 5.0
    text = daemon.log.read_text()
    assert "geheim" not in text
    assert "Traceback" not in text


def test_a_daemon_whose_parent_is_killed_leaves_no_worker(
    tmp_path: Path, feed_clip: Path, polygon: str
) -> None:
    with Daemon(tmp_path, camera("crusher-1", str(feed_clip), polygon, ", loop: true")) as daemon:
        wait_for("ready", lambda: daemon.ready, 60)
        workers = [pid for pids in daemon.children().values() for pid in pids]
        assert len(workers) == 3
        assert daemon.process is not None
        daemon.process.kill()
        daemon.process.wait()
        wait_for("workers gone", lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), 30)


def test_camera_and_monitor_of_two_daemons_share_only_the_bus(
    tmp_path: Path, feed_clip: Path, polygon: str
) -> None:
    """One daemon is the hub and reads the camera, the other joins it as a client and filters."""
    (tmp_path / "hub").mkdir()
    (tmp_path / "far").mkdir()
    cameras = camera("crusher-1", str(feed_clip), polygon, ", loop: true")
    hub, far = Daemon(tmp_path / "hub", cameras), Daemon(tmp_path / "far", cameras)
    endpoint = hub.config.read_text().partition('listen: ["')[2].partition('"')[0]
    text = far.config.read_text().replace("bus: {listen", "bus: {mode: client, connect")
    far.config.write_text(text.replace(text.partition('connect: ["')[2].partition('"')[0], endpoint))
    far.roles, hub.roles = ("--only", "monitor"), ("--only", "camera")
    with far:  # it waits for its hub
        time.sleep(2)
        assert far.process is not None
        assert far.process.poll() is None
        with hub:
            wait_for("far monitor decides", lambda: far.ready, 60)
            wait_for("hub counts", lambda: hub.metric("lumpwatch_frames_received_total") > 0, 30)
            assert hub.metric("lumpwatch_frames_processed_total") == 0
            assert hub.get("/readyz")[0] == 200  # no region is its own
            wait_for("far one counts", lambda: far.metric("lumpwatch_frames_processed_total") > 0, 30)
            hub.stop()
            wait_for("far monitor is blind", lambda: far.metric("lumpwatch_roi_blind") == 1, 30)
        code, seconds = far.stop()
        assert code == 0
        assert seconds < 8.0


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory, feed_clip: Path, polygon: str) -> Iterator[Daemon]:
    """One that plays a file for ever, for tests that leave it well."""
    folder = tmp_path_factory.mktemp("looped")
    with Daemon(folder, camera("crusher-1", str(feed_clip), polygon, ", loop: true")) as daemon:
        wait_for("ready", lambda: daemon.ready, 60)
        yield daemon


def test_a_new_prior_is_taken_without_a_restart(daemon: Daemon) -> None:
    assert daemon.metric("lumpwatch_prior_version") == 0
    where = ("--camera", "crusher-1", "--roi", "apron")
    for version in (1, 2):
        assert daemon.command("priors", "import", str(daemon.config), str(PRIOR), *where).returncode == 0

        def taken(version: int = version) -> bool:
            return daemon.metric("lumpwatch_prior_version") == version

        wait_for("prior taken", taken, 30)
    rolled = daemon.command("priors", "rollback", str(daemon.config), *where, "--version", "1")
    assert rolled.returncode == 0
    wait_for("rolled back", lambda: daemon.metric("lumpwatch_prior_version") == 1, 30)
    assert daemon.metric("lumpwatch_worker_restarts_total") == 0
    assert daemon.ready


def test_malformed_frames_are_counted_and_harmless(daemon: Daemon) -> None:
    config = load_config(daemon.config)
    with open_client(as_client(config.bus)) as bus:
        publisher = bus.publisher(Keys("test").frame("crusher-1"))
        for payload in (b"", b"\x00" * 10, os.urandom(100_000)):
            for _ in range(5):
                publisher.put(payload)
                time.sleep(0.02)
    wait_for(
        "counted",
        # Whoever sends them is not the camera that is listened to.
        lambda: daemon.metric("lumpwatch_frames_dropped_total", reason="second_source") >= 1,
        30,
    )
    assert daemon.ready
    assert daemon.metric("lumpwatch_worker_restarts_total") == 0


@pytest.mark.parametrize(
    ("store", "reason"), [(None, "is watched by process"), ("other", "cannot listen on tcp/127.0.0.1")]
)
def test_what_keeps_the_daemon_from_starting(
    daemon: Daemon, store: str | None, reason: str, tmp_path: Path
) -> None:
    """A store or a port that is taken: one line that names it, and a code that is not 0."""
    config = daemon.config
    if store is not None:
        text = config.read_text(encoding="utf-8")
        config = tmp_path / "site.yaml"
        config.write_text(text.replace("{path: var", f"{{path: {tmp_path / store}"), encoding="utf-8")
    second = daemon.command("run", str(config))
    assert second.returncode == 1
    told = [line for line in second.stderr.splitlines() if line.startswith("lumpwatch: ")]
    assert len(told) == 1
    assert reason in told[0]
    assert "Traceback" not in second.stderr


def test_a_stuck_camera_process_is_killed(daemon: Daemon) -> None:
    (pid,) = daemon.children()["camera"]
    os.kill(pid, signal.SIGSTOP)
    wait_for("blind", lambda: daemon.metric("lumpwatch_roi_blind") == 1, 30)
    wait_for(
        "stuck process replaced",
        lambda: daemon.metric("lumpwatch_worker_restarts_total", reason="stuck") == 1,
        40,
    )
    wait_for("ready again", lambda: daemon.ready, 60)
