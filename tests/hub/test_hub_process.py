"""The hub's process: what it says when it cannot start, how it ends, and how it keeps to its memory."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from lumpwatch.service.bus import open_client
from lumpwatch.service.config import BusConfig
from lumpwatch.service.hub import run_hub
from lumpwatch.service.hub.hub_process import Allowance
from lumpwatch.service.telemetry import Report, resident_bytes
from tests.bus.test_bus_support import client_config, free_endpoint, hub_config

MIB = 1 << 20


class Use:
    """Memory as the test has it."""

    def __init__(self) -> None:
        self.bytes, self.free, self.now_s, self.trims = 100 * MIB, 0, 0.0, 0

    def trim(self) -> None:
        self.trims += 1
        self.bytes -= self.free
        self.free = 0


def test_what_is_taken_beyond_the_start_counts_and_what_is_free_does_not() -> None:
    use = Use()
    allowance = Allowance(200 * MIB, lambda: use.bytes, use.trim, lambda: use.now_s)
    use.bytes += 40 * MIB
    assert allowance.exceeded() is None
    assert use.trims == 0
    use.bytes, use.free = 400 * MIB, 150 * MIB
    assert allowance.exceeded() is None
    assert use.trims == 1
    use.now_s += 60.0  # a quarter is taken: what is free is given back now and then
    assert allowance.exceeded() is None
    assert use.trims == 2
    use.bytes = 301 * MIB
    told = allowance.exceeded()
    assert told is not None
    assert "bus.hub.memory_mib (200)" in told


def test_resident_memory_is_read_and_unknown_is_no_error(tmp_path: Path) -> None:
    statm = tmp_path / "statm"
    statm.write_text("200000 20374 500 1 0 9000 0\n")
    assert resident_bytes(statm) == 20374 * os.sysconf("SC_PAGE_SIZE")
    assert resident_bytes(tmp_path / "missing") == 0
    assert resident_bytes() > MIB or sys.platform != "linux"


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
def test_a_process_cannot_grow_beyond_its_limit() -> None:
    code = (
        "from lumpwatch.service.hub import memory\n"
        "memory.forbid_growth(64 << 20)\n"
        "some = bytearray(32 << 20)\n"
        "print('some', flush=True)\n"
        "more = bytearray(64 << 20)\n"
        "print('more', flush=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == ["some"]
    assert done.returncode != 0


@contextmanager
def hub(config: BusConfig) -> Iterator[tuple[multiprocessing.process.BaseProcess, Connection]]:
    """The process, and the daemon's end of its line."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=run_hub, args=(config, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        yield process, ours
    finally:
        process.kill()
        process.join()


def report(line: Connection, state: str = "") -> Report:
    """The next report, or the next one of a state."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if line.poll(1.0):
            told = line.recv()
            assert isinstance(told, Report)
            if state in ("", told.state) or told.problem:
                return told
    raise AssertionError("the hub said nothing")


@pytest.mark.slow
def test_it_listens_survives_signals_and_ends_with_its_daemon() -> None:
    endpoint = free_endpoint()
    with hub(hub_config(endpoint)) as (process, line):
        running = report(line, "running")
        assert running.problem == ""
        assert 'lumpwatch_process_resident_memory_bytes{camera="",process="hub"}' in running.metrics
        with open_client(client_config(endpoint), wait=False) as client:
            process.terminate()  # as for every process of a service
            with hub(hub_config(endpoint)) as (_, second):
                problem = report(second, "failed").problem
            assert endpoint in problem
            assert "in use" in problem
            assert client.connected
        line.close()
        process.join(timeout=10.0)
        assert process.exitcode == 0
