"""A real Dask cluster on this machine: two workers, one killed in the middle; and clusters that are not there."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lumpwatch.service.batch import ClusterWorkers
from lumpwatch.service.batch.finished import Finished
from lumpwatch.service.cli import main
from lumpwatch.service.errors import LumpwatchError
from tests.batch.test_local import until
from tests.offline.test_backtest_run import folder  # noqa: F401 - the archive

pytest.importorskip("distributed", reason="the extra dask is not installed")

Process = subprocess.Popen[bytes]
ROOT = Path(__file__).parents[2]


def start(place: Path, name: str, *arguments: str) -> Process:
    """The scheduler or a worker, as a site would start it; what it says goes to a file."""
    with (place / f"{name}.log").open("wb") as log:
        command = [sys.executable, "-m", f"distributed.cli.dask_{name.partition('-')[0]}", *arguments]
        return subprocess.Popen(
            command, cwd=place, stdout=log, stderr=log, env=os.environ | {"PYTHONPATH": str(ROOT)}
        )


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[Process]]]:
    """The scheduler's address, and its workers; without nannies, so one that is killed stays dead."""
    place = tmp_path_factory.mktemp("cluster")
    here = ("--host", "127.0.0.1")
    processes = [start(place, "scheduler", *here, "--port", "0", "--no-dashboard", "--no-show")]
    try:
        log = place / "scheduler.log"
        until(lambda: re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text()) is not None)
        found = re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text())
        assert found is not None
        alone = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        processes += [start(place, f"worker-{k}", found[1], *here, *alone) for k in range(2)]
        with ClusterWorkers(found[1], 60.0) as workers:
            until(lambda: workers.width() == 2)
        yield found[1], processes[1:]
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_of_a_backtest_changes_no_byte(
    cluster: tuple[str, list[Process]],
    folder: Path,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Six videos; when the first is done one worker dies, with what it had in hand. One machine says the same bytes."""
    address, (_, victim) = cluster
    videos = []
    for k in range(6):
        videos.append(Path(shutil.copy(folder / f"{('lump', 'quiet')[k % 2]}.mp4", tmp_path / f"{k}.mp4")))
        shutil.copy(folder / f"{('lump', 'quiet')[k % 2]}.txt", tmp_path / f"{k}.txt")
    command = ["backtest", str(folder / "site.yaml"), "--videos", *map(str, videos)]
    keep = Finished.keep

    def kept(self: Finished[object], key: str, result: object) -> None:
        victim.send_signal(signal.SIGKILL)
        keep(self, key, result)

    with monkeypatch.context() as patched:
        patched.setattr(Finished, "keep", kept)
        there = [
            *command,
            "--out",
            str(tmp_path / "there"),
            "--dask",
            address,
            "--resume",
            str(tmp_path / "kept"),
        ]
        assert main(there) == 0
    assert victim.wait(10) == -signal.SIGKILL
    assert len(list((tmp_path / "kept").iterdir())) == 6
    assert main([*command, "--out", str(tmp_path / "here"), "--workers", "1"]) == 0
    for name in ("backtest.json", "lumps.csv"):
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


def test_clusters_that_are_not_there() -> None:
    with pytest.raises(LumpwatchError, match=r"--dask tcp://127\.0\.0\.1:9: no scheduler answers"):
        ClusterWorkers("tcp://127.0.0.1:9", 0.3)
    with pytest.raises(LumpwatchError, match="--dask nonsense://x: no scheduler answers"):
        ClusterWorkers("nonsense://x", 0.3)
