"""The queue of long work, with real processes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from lumpwatch.service.cli.common import ProgressFile
from lumpwatch.service.console.work import Job, JobError, OrderError, Queue, read_order
from tests.bus.test_bus_support import eventually


class Bench:
    """A queue whose jobs are what `order["arguments"]` says."""

    def __init__(self, folder: Path, most: int = 1 << 20) -> None:
        self.done: list[str] = []
        self.folder = folder
        self.queue = Queue(folder, most, self._command, lambda job, _: self.done.append(job.id))

    def put(self, *arguments: str) -> str:
        return self.queue.put("train", {"arguments": list(arguments)}, "clip", "emma").id

    def state(self, job: str) -> str:
        return self.queue.job(job).state

    def ended(self, job: str) -> str:
        eventually(lambda: self.queue.job(job).ended, 30.0)
        return self.state(job)

    @staticmethod
    def _command(job: Job, folder: Path) -> Sequence[str]:
        return list(job.order["arguments"])


@pytest.fixture
def waits(tmp_path: Path) -> tuple[str, ...]:
    """A command that runs until it is ended: it follows alarms of a daemon that is not there."""
    config = tmp_path / "site.yaml"
    config.write_text(
        'site: pit\nbus: {mode: client, connect: ["tcp/127.0.0.1:9"]}\ncameras:\n  - {id: cam, '
        'source: {url: "sim:feed"}, rois: [{id: a, polygon: [[0.1, 0.1], [0.9, 0.1], [0.9, 0.9]]}]}\n'
    )
    return ("console", str(config))


def test_jobs_run_one_after_the_other_and_say_what_went_wrong(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "jobs")
    good, bad = bench.put("--version"), bench.put("check", "missing.yaml")
    assert bench.ended(good) == "done"
    assert bench.ended(bad) == "failed"
    assert "missing.yaml" in bench.queue.job(bad).said
    assert bench.queue.log(good).startswith("lumpwatch ")
    assert bench.done == [good]
    first, second = (bench.queue.job(name) for name in (good, bad))
    assert first.ended is not None
    assert second.began is not None
    assert first.ended <= second.began
    bench.queue.close()


def test_a_job_that_runs_and_one_that_waits_are_cancelled(tmp_path: Path, waits: tuple[str, ...]) -> None:
    bench = Bench(tmp_path / "jobs")
    running, waiting = bench.put(*waits), bench.put("--version")
    eventually(lambda: bench.queue.job(running).pid, 20.0)
    pid = bench.queue.job(running).pid
    assert pid is not None
    with pytest.raises(JobError, match="not over"):
        bench.queue.remove(running)
    bench.queue.cancel(waiting, "emma")
    bench.queue.cancel(running, "emma")
    assert bench.ended(running) == bench.state(waiting) == "cancelled"
    eventually(lambda: not Path(f"/proc/{pid}").exists(), 20.0)
    assert bench.queue.job(waiting).began is None
    third = bench.put("--version")
    assert bench.ended(third) == "done", "the queue stands still"
    bench.queue.remove(running)
    assert not (tmp_path / "jobs" / running).exists()
    bench.queue.close()


def test_the_queue_goes_on_after_a_restart_and_what_ran_is_interrupted(
    tmp_path: Path, waits: tuple[str, ...]
) -> None:
    bench = Bench(tmp_path / "jobs")
    running, waiting = bench.put(*waits), bench.put("--version")
    eventually(lambda: bench.queue.job(running).pid, 20.0)
    pid = bench.queue.job(running).pid
    bench.queue.close()
    eventually(lambda: not Path(f"/proc/{pid}").exists(), 20.0)
    again = Bench(tmp_path / "jobs")
    assert again.state(running) == "interrupted"
    assert again.ended(waiting) == "done"
    again.queue.close()


def test_a_console_that_was_killed_leaves_no_work_running(tmp_path: Path, waits: tuple[str, ...]) -> None:
    bench = Bench(tmp_path / "jobs")
    running = bench.put(*waits)
    eventually(lambda: bench.queue.job(running).pid, 20.0)
    pid = bench.queue.job(running).pid
    again = Bench(tmp_path / "jobs")  # as if the first had been killed: its file says that the job runs
    assert again.state(running) == "interrupted"
    eventually(lambda: bench.queue.job(running).state == "failed", 20.0)
    assert not Path(f"/proc/{pid}").exists()
    for one in (bench, again):
        one.queue.close()


def test_old_results_make_room(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "jobs", most=300_000)
    for _ in range(3):
        name = bench.put("--version")
        (tmp_path / "jobs" / name / "overlay.mp4").write_bytes(bytes(200_000))
        bench.ended(name)
    eventually(lambda: len(bench.queue.jobs()) == 1)
    assert bench.queue.jobs()[0].id == name
    bench.queue.close()


def test_a_file_that_is_not_a_job_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "jobs" / "x").mkdir(parents=True)
    (tmp_path / "jobs" / "x" / "job.json").write_text("{}")
    assert Bench(tmp_path / "jobs").queue.jobs() == []


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "kind"),
        ({"kind": "rm -rf"}, "kind"),
        ({"kind": "train", "camera": "c", "roi": "r", "clips": ["../x"]}, "clips.0"),
        ({"kind": "train", "camera": "c", "roi": "r", "clips": [], "folds": 1}, "folds"),
        ({"kind": "replay", "camera": "c", "clip": "20260101T000000-000000", "out": "/etc"}, "out"),
    ],
)
def test_orders_are_checked_when_they_are_given(given: dict[str, object], says: str) -> None:
    with pytest.raises(OrderError, match=says):
        read_order(given)


def test_progress_for_another_program_is_replaced_at_most_four_times_a_second(tmp_path: Path) -> None:
    now = [0.0]
    file = ProgressFile(tmp_path / "p.json", "reading", 10, lambda: now[0])
    file.told(3)
    assert json.loads((tmp_path / "p.json").read_text()) == {"stage": "reading", "done": 0, "total": 10}
    now[0] = 0.3
    file.told(4)
    assert json.loads((tmp_path / "p.json").read_text())["done"] == 4
    file.told(10)
    assert json.loads((tmp_path / "p.json").read_text())["done"] == 10, "the end is not told"
