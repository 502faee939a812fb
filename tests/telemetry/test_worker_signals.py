"""A worker that gets the signal of its whole service ends in order."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

CODE = """
import multiprocessing, os, sys
from prometheus_client import CollectorRegistry
from lumpwatch.service.telemetry import DaemonConnection
ours, theirs = multiprocessing.Pipe()
daemon = DaemonConnection(theirs, CollectorRegistry())
daemon.obey_signals()
os.kill(os.getpid(), int(sys.argv[1]))
assert daemon.wait(30.0)
print("in order", flush=True)
if sys.argv[2] == "stuck":
    import threading
    threading.Event().wait()
daemon.close()
"""


@pytest.mark.parametrize(
    ("number", "then", "code"), [(signal.SIGTERM, "well", 0), (signal.SIGINT, "stuck", 1)]
)
def test_signals_ask_a_worker_to_end(number: signal.Signals, then: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(int(number)), then], capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.returncode) == ("in order\n", code), done.stderr
