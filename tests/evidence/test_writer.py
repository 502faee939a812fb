"""Evidence on its way to the disk: whole or not at all, bounded, and never in the way of detection."""

from __future__ import annotations

import errno
import logging
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.config.evidence import EvidenceConfig
from lumpwatch.service.evidence.files import write_files
from lumpwatch.service.evidence.folder import EvidenceError, read_evidence
from lumpwatch.service.evidence.recorder import Clip
from lumpwatch.service.evidence.store import Entry, EvidenceStore
from lumpwatch.service.evidence.writer import EvidenceWriter, Origin
from lumpwatch.service.protocol.evidence import META, EvidenceMeta
from lumpwatch.service.storage.prior_file import Prior
from tests.evidence.scene import Counting, Scene, moving
from tests.integration.site import wait_for
from tests.service_helpers import camera, prior

DAY_S = 86_400.0
NOW_S = 1.7e9 + 2000.0


@pytest.fixture(scope="module")
def clip() -> Clip:
    scene = Scene(camera(), {"apron": prior()})
    scene.show(2.0, lambda k: moving(k, visible=True))
    return scene.clips[0]


def named(clip: Clip, time_s: float, sequence: int = 1) -> Clip:
    name = f"{round(time_s * 1000):015d}-{sequence:06d}"
    return replace(clip, trigger=replace(clip.trigger, id=name, sequence=sequence, wall_s=time_s))


class Run:
    """A writer with its store."""

    def __init__(
        self,
        folder: Path,
        fill: Callable[..., EvidenceMeta] = write_files,
        judged: Callable[[Entry], bool] = lambda _: False,
        **config: Any,
    ) -> None:
        self.store = EvidenceStore(folder)
        self.counting = Counting()
        self.writer = EvidenceWriter(
            self.store,
            Origin("pit", camera(), "1.2.3"),
            EvidenceConfig.model_validate({"least_free_mb": 0} | config),
            self.counting,
            lambda: judged,
            lambda: NOW_S,
            fill,
        )

    def write(self, *clips: Clip) -> None:
        for clip in clips:
            self.writer.submit(clip)
        wait_for("written", lambda: self.writer.waiting() == 0, 60)
        self.writer.close()

    def ids(self) -> list[str]:
        return [one.id for one in self.store.entries()]


def put(store: EvidenceStore, camera_id: str, time_s: float, size: int) -> str:
    """A folder that looks like evidence of so many bytes."""
    name = f"{round(time_s * 1000):015d}-000001"
    folder = store.folder(camera_id, "apron", name)
    folder.mkdir(parents=True)
    (folder / META).write_bytes(b"{}")
    (folder / "clip.mkv").write_bytes(bytes(size - 2))
    return name


def test_a_clip_becomes_a_folder_that_reads_back(tmp_path: Path, clip: Clip) -> None:
    run = Run(tmp_path)
    run.write(clip)
    (entry,) = run.store.entries()
    assert (entry.camera, entry.roi, entry.id) == ("cam", "apron", clip.trigger.id)
    assert entry.time_s == pytest.approx(clip.trigger.wall_s, abs=1e-3)
    evidence = run.store.find(clip.trigger.id)
    evidence.check()
    assert evidence.meta.name == f"cam/apron/{clip.trigger.id}"
    assert (evidence.meta.software, evidence.meta.ended) == ("1.2.3", "post_roll")
    assert evidence.read("still.jpg")[:2] == b"\xff\xd8"
    assert run.counting.written == {"apron": 1}
    assert run.counting.stored == entry.size == evidence.meta.size + (entry.folder / META).stat().st_size
    assert run.store.find(evidence.meta.name).folder == entry.folder
    assert not list((tmp_path / "evidence" / "cam").glob(".*"))


def test_names_that_are_none_are_refused(tmp_path: Path, clip: Clip) -> None:
    run = Run(tmp_path)
    run.write(clip)
    for name in ("nothing", "cam/apron/nothing", "other/apron/" + clip.trigger.id, "..", "a/b/c/d"):
        with pytest.raises(EvidenceError, match="holds no evidence"):
            run.store.find(name)
    with pytest.raises(EvidenceError, match="not the id"):
        run.store.folder("cam", "apron", "../../../etc")


# Bounds


def test_what_is_too_old_goes_and_what_was_judged_stays_longer(tmp_path: Path, clip: Clip) -> None:
    store = EvidenceStore(tmp_path)
    old = put(store, "other", NOW_S - 91 * DAY_S, 100)
    put(store, "cam", NOW_S - 401 * DAY_S, 100)
    marked = put(store, "cam", NOW_S - 399 * DAY_S, 100)
    young = put(store, "cam", NOW_S - 89 * DAY_S, 100)
    run = Run(tmp_path, judged=lambda one: one.camera == "cam", keep_days=90, keep_judged_days=400)
    run.write(named(clip, NOW_S))
    assert run.ids() == [marked, young, f"{round(NOW_S * 1000):015d}-000001"]
    assert run.counting.removed == {"age": 2}
    assert not store.folder("other", "apron", old).exists()


def test_the_oldest_goes_where_space_is_short_and_the_judged_last(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path)
    names = [put(store, "cam", NOW_S - 1000 + k, 300 << 10) for k in range(10)]
    run = Run(tmp_path, judged=lambda one: one.id in names[:2], max_mb=1)
    wait_for("bounded", lambda: len(run.ids()) == 3, 60)
    run.writer.close()
    assert run.ids() == [*names[:2], names[9]]
    assert run.counting.removed == {"space": 7}
    assert store.prune(EvidenceConfig(max_mb=1), NOW_S, lambda _: True) == {"age": 0, "space": 0}
    assert store.prune(EvidenceConfig(keep_days=0.001), NOW_S + 1e4, lambda _: True)["age"] == 3


def test_evidence_leaves_room_on_its_disk(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path, disk=lambda _: 10 << 20)
    for k in range(1, 6):
        folder = tmp_path / "evidence" / "cam" / "apron" / f"{k:015}-000001"
        folder.mkdir(parents=True)
        (folder / META).write_bytes(b"{}")
        (folder / "clip.mkv").write_bytes(bytes(2 << 20))
    config = EvidenceConfig(max_mb=10_000, max_share=0.5)
    assert store.limit(config) == 5 << 20
    assert store.limit(EvidenceConfig(max_mb=3)) == 3 << 20
    assert store.prune(config, 1.0, lambda _: False) == {"age": 0, "space": 3}
    assert [entry.id for entry in store.entries()] == [f"{k:015}-000001" for k in (4, 5)]


def test_what_is_being_written_is_no_evidence_and_never_removed(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path)
    half = tmp_path / "evidence" / "other" / ".writing.apron.000000000000001-000001"
    half.mkdir(parents=True)
    (half / META).write_bytes(b"{}")
    (half / "clip.mkv").write_bytes(bytes(5 << 20))
    removed = store.prune(EvidenceConfig(max_mb=1, keep_days=1), NOW_S, lambda _: False)
    assert removed == {"age": 0, "space": 0}
    assert half.exists()
    assert store.entries() == []


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path, clip: Clip) -> None:
    own = tmp_path / "evidence" / "cam"
    (own / ".writing.apron.000000000000001-000001").mkdir(parents=True)
    half_removed = own / "apron" / "000000000000002-000001"
    half_removed.mkdir(parents=True)
    (half_removed / "clip.mkv").write_bytes(b"x")
    other = tmp_path / "evidence" / "other" / ".writing.apron.000000000000001-000001"
    other.mkdir(parents=True)
    run = Run(tmp_path)
    run.write(clip)
    assert [one.name for one in own.iterdir()] == ["apron"]
    assert run.ids() == [clip.trigger.id]
    assert other.exists()  # its own monitor may be writing it


def test_a_kill_while_writing_leaves_no_evidence(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path)

    def killed(folder: Path) -> EvidenceMeta:
        (folder / "clip.mkv").write_bytes(b"half")
        (folder / META).write_bytes(b"{}")
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError

    child = os.fork()
    if child == 0:
        store.write("cam", "apron", "000001700000000-000001", killed)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert store.entries() == []
    assert len(list((tmp_path / "evidence" / "cam").iterdir())) == 1
    assert store.clean("cam") == 1
    assert list((tmp_path / "evidence" / "cam").iterdir()) == []


# Trouble


def failing(number: int) -> Callable[..., EvidenceMeta]:
    """Fails with that errno twice, then works."""
    left = [2]

    def fill(folder: Path, clip: Clip, site: str, one: CameraConfig, software: str) -> EvidenceMeta:
        if left[0]:
            left[0] -= 1
            (folder / "clip.mkv").write_bytes(b"half")
            raise OSError(number, os.strerror(number))
        return write_files(folder, clip, site, one, software)

    return fill


@pytest.mark.parametrize(("number", "reason"), [(errno.ENOSPC, "disk_full"), (errno.EROFS, "unwritable")])
def test_trouble_is_counted_said_once_and_over_when_it_is(
    tmp_path: Path, clip: Clip, caplog: pytest.LogCaptureFixture, number: int, reason: str
) -> None:
    caplog.set_level(logging.INFO)
    run = Run(tmp_path, failing(number))
    run.write(*(named(clip, NOW_S + k, k) for k in range(1, 4)))
    assert run.counting.problems == {reason: 2}
    assert run.counting.written == {"apron": 1}
    assert [one.rpartition("-")[2] for one in run.ids()] == ["000003"]
    assert caplog.text.count("evidence cannot be kept") == 1
    assert "detection goes on" in caplog.text
    assert caplog.text.count("evidence: written again") == 1
    assert not list((tmp_path / "evidence" / "cam").glob(".*"))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 192 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=192k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("cannot mount a small file system (needs root)")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_disk_that_is_really_full(small_disk: Path, clip: Clip) -> None:
    run = Run(small_disk, max_share=1.0)
    for k in range(1, 4):
        run.writer.submit(named(clip, NOW_S + k, k))
    wait_for("given up", lambda: run.writer.waiting() == 0, 60)
    assert run.counting.problems["disk_full"] >= 1
    before = run.ids()
    for one in run.store.entries():
        read_evidence(one.folder).check()
    subprocess.run(["mount", "-o", "remount,size=8m", small_disk], check=True)
    run.write(named(clip, NOW_S + 9, 9))
    assert [one.rpartition("-")[2] for one in run.ids()] == [
        *(one.rpartition("-")[2] for one in before),
        "000009",
    ]


def test_a_store_that_is_really_read_only(small_disk: Path, clip: Clip) -> None:
    subprocess.run(["mount", "-o", "remount,ro,size=8m", small_disk], check=True)
    run = Run(small_disk)
    run.writer.submit(clip)
    wait_for("given up", lambda: run.writer.waiting() == 0, 60)
    assert run.counting.problems == {"unwritable": 1}
    subprocess.run(["mount", "-o", "remount,rw", small_disk], check=True)
    run.write(clip)
    assert run.ids() == [clip.trigger.id]


def test_a_disk_with_little_space_left_is_kept_for_the_event_log(tmp_path: Path, clip: Clip) -> None:
    run = Run(tmp_path, least_free_mb=100_000_000)
    run.write(clip)
    assert run.counting.problems == {"disk_full": 1}
    assert run.ids() == []


def test_a_disk_that_does_not_answer_holds_nobody_up(tmp_path: Path, clip: Clip) -> None:
    go = threading.Event()

    def stalled(*arguments: Any) -> EvidenceMeta:
        go.wait(60)
        return write_files(*arguments)

    run = Run(tmp_path, stalled)
    config = EvidenceConfig(pre_roll_s=2.0, post_roll_s=0.3, memory_mb=1)
    priors: dict[str, Prior | None] = {"apron": prior()}
    scene = Scene(camera(), priors, config, submit=run.writer.submit, waiting=run.writer.waiting)
    for _ in range(40):
        scene.show(0.5, lambda k: moving(k, visible=False))
        scene.begin("apron", clip.trigger.alarm_class, scene.live[-1].frame.received_s)  # type: ignore[union-attr]
    assert 0 < run.writer.waiting() <= 2 << 20  # what waits is bounded
    assert scene.counting.problems["memory"] > 0
    assert len(scene.live) == 200
    go.set()
    wait_for("caught up", lambda: run.writer.waiting() == 0, 60)
    run.writer.close()
    assert len(run.ids()) == run.counting.written["apron"] > 2
