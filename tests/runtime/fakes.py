"""Processes, a clock and workers that tests of the runtime steer by hand: no process is started."""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass, field
from itertools import count
from multiprocessing.connection import Connection

from lumpwatch.service.runtime.supervisor import Process, Task
from lumpwatch.service.telemetry import Report

_numbers = count(1000)


@dataclass
class FakeClock:
    """Stands still until it is moved."""

    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class FakeProcess:
    """Runs until it is ended; `immortal`: SIGKILL does not end it, as in an uninterruptible system call."""

    clock: FakeClock
    line: Connection
    """The worker's end."""
    immortal: bool = False
    pid: int | None = field(default_factory=lambda: next(_numbers))
    exitcode: int | None = None
    kills: int = 0
    closed: bool = False

    def is_alive(self) -> bool:
        assert not self.closed
        return self.exitcode is None

    def join(self, timeout: float | None = None) -> None:
        """Time passes while somebody waits for one that runs on."""
        if self.is_alive():
            assert timeout is not None, "waits for ever"
            self.clock.now_s += timeout

    def kill(self) -> None:
        self.kills += 1
        if not self.immortal:
            self.end(-9)

    def end(self, code: int) -> None:
        """It ends by itself: its end of the line is closed."""
        self.exitcode = code
        self.line.close()

    def close(self) -> None:
        assert not self.is_alive()
        self.closed = True


class FakeSystem:
    """Starts fake processes and remembers them by task, oldest first."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.processes: dict[str, list[FakeProcess]] = {}
        self.immortal: set[str] = set()
        """Tasks whose processes cannot be killed."""

    def start(self, task: Task) -> tuple[Process, Connection]:
        ours, theirs = multiprocessing.Pipe()
        process = FakeProcess(self.clock, theirs, immortal=task.name in self.immortal)
        self.processes.setdefault(task.name, []).append(process)
        return process, ours

    def newest(self, name: str) -> FakeProcess:
        return self.processes[name][-1]

    def report(self, name: str, state: str = "running", **decided: float) -> None:
        """The newest process of a task reports."""
        text = '# HELP level How high.\n# TYPE level gauge\nlevel{camera="cam"} 0.5\n'
        self.newest(name).line.send(Report(self.clock.now_s, text, state, decided))


@dataclass
class FakeWorkers:
    """Workers that say what the test lets them say."""

    said: dict[tuple[str, str], Report | None] = field(default_factory=dict)
    watches: int = 0
    stopped: bool = False

    def reports(self) -> dict[tuple[str, str], Report | None]:
        return self.said

    def watch(self) -> None:
        self.watches += 1

    def stop(self) -> tuple[str, ...]:
        self.stopped = True
        return ()


def soon(condition: object) -> None:
    """Wait until another thread has brought something about."""
    assert callable(condition)
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline, "what was waited for did not come"
        time.sleep(0.002)
