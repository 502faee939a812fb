"""Lists of tasks: order, failures, what was finished before, and how far it is."""

from __future__ import annotations

import json
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.batch.code import code_digest
from lumpwatch.service.batch.finished import Finished, file_identity, key_of
from lumpwatch.service.batch.run import AHEAD, Progress, run_tasks
from lumpwatch.service.batch.share import Share
from lumpwatch.service.batch.task import Failed, MismatchError, Task, do
from lumpwatch.service.cli.workers import in_words
from lumpwatch.service.errors import ConfigError, LumpwatchError
from tests.batch.work import double


def tasks(*numbers: int) -> list[Task[int]]:
    return [Task(f"{n}.mp4", n, key_of(str(n)), float(max(n, 1))) for n in numbers]


def kept(folder: Path) -> Finished[int]:
    return Finished(folder, lambda value: json.dumps(value).encode(), json.loads)


def run(*numbers: int, **more: Any) -> list[int | Failed]:
    with ThreadPoolExecutor(2) as threads:
        return run_tasks(tasks(*numbers), double, threads, lambda: 2, **more)


def test_a_task_that_fails_is_named_and_the_rest_goes_on() -> None:
    outcomes = run(5, 13, 0, 7)
    assert [one for one in outcomes if not isinstance(one, Failed)] == [10, 14]
    expected, unexpected = (one for one in outcomes if isinstance(one, Failed))
    assert expected == Failed("13.mp4", "thirteen.mp4: damaged")
    assert unexpected.reason.startswith("0.mp4: ZeroDivisionError: ")
    assert "double, line" in unexpected.reason


def test_what_is_finished_is_not_done_again_and_what_failed_is(tmp_path: Path) -> None:
    run(1, 2, 13, finished=kept(tmp_path))
    assert len(list(tmp_path.iterdir())) == 2
    done: list[int] = []

    def tripled(number: int) -> int:
        done.append(number)
        return 3 * number

    with ThreadPoolExecutor(1) as threads:
        again = run_tasks(tasks(1, 2, 13, 4), tripled, threads, lambda: 1, kept(tmp_path))
    assert again == [2, 4, 39, 12]
    assert done == [13, 4]


def test_a_damaged_result_is_done_again(tmp_path: Path) -> None:
    run(1, 2, finished=kept(tmp_path))
    path = tmp_path / f"{key_of('2')}.result"
    path.write_bytes(path.read_bytes()[:-1] + b"9")
    assert kept(tmp_path).load(key_of("2")) is None
    assert run(1, 2, finished=kept(tmp_path)) == [2, 4]
    assert kept(tmp_path).load(key_of("2")) == 4


def test_results_are_kept_as_they_come(tmp_path: Path) -> None:
    """What ends the run later costs nothing of what was finished."""

    def stop(now: Progress) -> None:
        if now.done == 2:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as threads, pytest.raises(KeyboardInterrupt):
        run_tasks(tasks(1, 2, 3, 4, 5, 6), double, threads, lambda: 1, kept(tmp_path), stop)
    assert kept(tmp_path).load(key_of("1")) == 2
    assert kept(tmp_path).load(key_of("2")) == 4
    assert kept(tmp_path).load(key_of("6")) is None


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LumpwatchError, match="file/kept: cannot be written"):
        kept(tmp_path / "file" / "kept")


class ByHand(Executor):
    """Does a task when it is told to."""

    def __init__(self) -> None:
        self.handed_out: list[tuple[Future[Any], Any]] = []
        self.most = 0

    def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.handed_out.append((future, lambda: function(*arguments)))
        self.most = max(self.most, sum(not one.done() for one, _ in self.handed_out))
        if len(self.handed_out) % AHEAD == 0:
            for one, work in self.handed_out:
                if not one.done():
                    one.set_result(work())
        return future


def test_little_is_handed_out_at_a_time() -> None:
    executor = ByHand()
    assert run_tasks(tasks(*range(14, 54)), double, executor, lambda: 1) == [2 * n for n in range(14, 54)]
    assert executor.most <= AHEAD


class Gone(Executor):
    """A cluster that is not there any more."""

    def submit(self, function: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(CancelledError())
        return future


def test_a_cluster_that_is_gone_ends_the_run() -> None:
    with pytest.raises(LumpwatchError, match=r"1\.mp4: the cluster dropped it"):
        run_tasks(tasks(1), double, Gone(), lambda: 1)


def test_a_worker_of_other_code_ends_the_run() -> None:
    with pytest.raises(MismatchError, match="other code"):
        do(double, tasks(1)[0], "0123456789ab")
    assert len(code_digest()) == 12


def test_the_estimate_goes_by_weight() -> None:
    """One task of weight 1 took 1 s, then one of 3 came at 8 s: four of ten in 8 s."""
    now = iter([0.0, 1.0, 8.0, 9.0])
    told: list[Progress] = []
    with ThreadPoolExecutor(1) as threads:
        run_tasks(tasks(1, 3, 6), double, threads, lambda: 1, None, told.append, lambda: next(now))
    assert [(one.done, one.left_s) for one in told] == [
        (1, pytest.approx(9.0)),
        (2, pytest.approx(12.0)),
        (3, 0.0),
    ]
    assert in_words(told[1]) == "2 of 3 done, some 12 s left"
    assert in_words(Progress(12, 100, 2, 7800.0)) == "12 of 100 done, 2 failed, some 2 h 10 min left"


def test_shares_are_everything_once() -> None:
    names = [str(k) for k in range(11)]
    assert sorted(name for k in range(4) for name in Share(k, 4).of(names)) == sorted(names)
    for text in ("4/4", "1", "-1/4", "a/b", "1/0", "²/4"):
        with pytest.raises(ConfigError, match="--share"):
            Share.parse(text)


def test_what_tells_a_video_from_another(tmp_path: Path) -> None:
    video = tmp_path / "a.mp4"
    video.write_bytes(b"123")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "1.png").write_bytes(b"1")
    assert file_identity(video).startswith("a.mp4 3 ")
    assert file_identity(tmp_path / "folder").startswith("1.png 1 ")
    with pytest.raises(OSError, match=r"gone\.mp4"):
        file_identity(tmp_path / "gone.mp4")
