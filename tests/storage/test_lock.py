"""A camera's place in a store is held by one process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lumpwatch.service.storage import StoreError, lock_cameras

HOLD = """
import sys
from pathlib import Path
from lumpwatch.service.storage import lock_cameras
with lock_cameras(Path(sys.argv[1]), ["a", "b"]):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused_and_told_by_whom(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        taken = lock_cameras(tmp_path, ["b"], patience_s=0.0)
        with pytest.raises(StoreError, match=rf"camera b is watched by process {other.pid} "), taken:
            pytest.fail("it was let in")
        with lock_cameras(tmp_path, ["c"], patience_s=0.0):
            pass
        other.kill()  # whatever ends a process, its lock goes with it
    with lock_cameras(tmp_path, ["a", "b"], patience_s=5.0):
        assert (tmp_path / "locks" / "a.lock").read_text() == f"{os.getpid()}\n"


def test_one_that_ends_meanwhile_is_waited_for(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdin is not None
        other.stdout.readline()
        other.stdin.close()
        with lock_cameras(tmp_path, ["a"], patience_s=30.0):
            pass


def test_a_store_that_cannot_be_locked_is_no_obstacle(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "locks").write_text("no folder")
    with lock_cameras(tmp_path, ["a"], patience_s=0.0):
        assert "cannot be locked" in caplog.text
