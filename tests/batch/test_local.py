"""Worker processes that die, take too much memory, or are left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from lumpwatch.service.batch.local import LocalWorkers
from lumpwatch.service.batch.run import run_tasks
from lumpwatch.service.batch.task import Failed, Task
from tests.batch.work import die, die_once, fill

PARENT = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what it runs behind it ignore it
from lumpwatch.service.batch import LocalWorkers, Task, run_tasks
from tests.batch.work import sleep
if __name__ == "__main__":
    with LocalWorkers(1) as workers:
        run_tasks([Task("long", sys.argv[1])], sleep, workers, lambda: 1)
"""


def until(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def alive(process: int) -> bool:
    """Whether it runs; a zombie does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
def test_workers_that_die_cost_no_other_task(tmp_path: Path) -> None:
    """One task kills whoever tries and is named; one is killed once by something else and is done after all."""
    with LocalWorkers(2, 600 << 20) as workers:
        deaths = run_tasks([Task(f"{n}.mp4", n) for n in (1, 13, 2, 3)], die, workers, lambda: 2)
        once = run_tasks([Task("once", str(tmp_path / "marker"))], die_once, workers, lambda: 2)
        filled = run_tasks([Task(f"{n} MB", n) for n in (900, 1)], fill, workers, lambda: 2)
    assert [deaths[0], *deaths[2:]] == [2, 4, 6]
    assert isinstance(deaths[1], Failed)
    assert deaths[1].reason == "13.mp4: its worker process ended in the middle of it (out of memory?)"
    assert once == [str(tmp_path / "marker")]
    assert isinstance(filled[0], Failed)
    assert filled[0].reason == "900 MB: takes more memory than a worker may have"
    assert filled[1] == 1


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_is_left_behind(tmp_path: Path, number: int) -> None:
    """A run that is interrupted or killed in the middle of a long task takes its workers along."""
    marker, script = tmp_path / "began", tmp_path / "parent.py"
    script.write_text(PARENT)
    root = Path(__file__).parents[2]
    parent = subprocess.Popen(
        [sys.executable, str(script), str(marker)],
        env=os.environ | {"PYTHONPATH": str(root)},
        stderr=subprocess.DEVNULL,
    )
    try:
        until(lambda: marker.exists() and marker.read_text() != "")
        worker = int(marker.read_text())
        assert alive(worker)
        parent.send_signal(number)
        parent.wait(120)
        until(lambda: not alive(worker), 30.0)
    finally:
        parent.kill()
        parent.wait()
