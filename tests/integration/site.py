"""A daemon in a process of its own, and the means to look at it from outside."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from prometheus_client.parser import text_string_to_metric_families

from lumpwatch.service.cli import main

LUMPWATCH = (sys.executable, "-m", "lumpwatch.service.cli")


APART = ("run", "replay", "evidence")
"""Commands that take over a process, or that are to work without what this one has."""


def _text(stream: io.TextIOWrapper) -> str:
    stream.flush()
    stream.seek(0)
    return stream.read()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(what: str, condition: Callable[[], Any], within_s: float) -> Any:
    """The first true value of `condition`, looked at often; fails after `within_s`."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"{what}: not within {within_s} s")


class Daemon:
    """`lumpwatch run` on a configuration; a context manager that ends it."""

    def __init__(self, folder: Path, cameras: str, bus: str = 'listen: ["tcp/127.0.0.1:{port}"]') -> None:
        """`bus` is what its part of the configuration holds; `{port}` becomes a free port."""
        self.folder = folder
        self.port = free_port()
        self.config = folder / "site.yaml"
        self.config.write_text(
            f"""\
site: test
bus: {{{bus.replace("{port}", str(free_port()))}}}
store: {{path: var, poll_s: 0.2}}
telemetry: {{listen: "127.0.0.1:{self.port}"}}
cameras:
{cameras}"""
        )
        self.log = folder / "daemon.log"
        self.roles: tuple[str, ...] = ()
        self.environment: dict[str, str] = {}
        self.process: subprocess.Popen[bytes] | None = None

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run one `lumpwatch` command to its end: in a process of its own where it tests that, else in this one.

        A process of its own takes a second to load.
        """
        if arguments[0] in APART:
            return subprocess.run([*LUMPWATCH, *arguments], capture_output=True, text=True, timeout=120)
        out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(list(arguments))
        told, failed = (_text(stream) for stream in (out, err))
        return subprocess.CompletedProcess(arguments, code, told, failed)

    def start(self) -> None:
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [*LUMPWATCH, "run", str(self.config), *self.roles],
                stdout=log,
                stderr=log,
                env=os.environ | self.environment,
            )

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            print(self.log.read_text())
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=60)
            except subprocess.TimeoutExpired:
                self.process.kill()
                raise

    def stop(self, *, everyone: bool = False) -> tuple[int, float]:
        """Ask the daemon to stop; its exit code and the seconds it took.

        With `everyone` its processes get the signal first, as from systemd or a terminal.
        """
        assert self.process is not None
        began = time.monotonic()
        for pid in (pid for pids in self.children().values() for pid in pids if everyone):
            os.kill(pid, signal.SIGTERM)
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=60), time.monotonic() - began

    def get(self, path: str) -> tuple[int, str]:
        """Status and text of a page; status 0 while nobody listens."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=20) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except OSError:
            return 0, ""

    @property
    def ready(self) -> bool:
        return self.get("/readyz")[0] == 200

    def metric(self, name: str, **labels: str) -> float:
        """Sum of the samples of that name that carry the labels."""
        total = 0.0
        for family in text_string_to_metric_families(self.get("/metrics")[1]):
            for sample in family.samples:
                if sample.name == name and labels.items() <= sample.labels.items():
                    total += sample.value
        return total

    def shows(self, name: str, **labels: str) -> bool:
        """Whether there is any sample of that name that carries the labels."""
        return any(
            sample.name == name and labels.items() <= sample.labels.items()
            for family in text_string_to_metric_families(self.get("/metrics")[1])
            for sample in family.samples
        )

    def worker(self, role: str, camera: str = "") -> int:
        """Process id of one worker, as the log has it."""
        name = f"{role}:{camera}" if camera else role
        return int(re.findall(rf"{name} runs as process (\d+)", self.log.read_text())[-1])

    def children(self) -> dict[str, list[int]]:
        """Process ids of the workers by role, found in the process table."""
        assert self.process is not None
        found: dict[str, list[int]] = {"camera": [], "monitor": [], "hub": []}
        hub = re.findall(r"hub runs as process (\d+)", self.log.read_text())
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                libraries = (entry / "maps").read_text()
            except (OSError, ValueError):
                continue
            if parent == self.process.pid and b"spawn_main" in (entry / "cmdline").read_bytes():
                # Only the monitor loads the compiler of the filter's kernels.
                role = "hub" if entry.name in hub else "monitor" if "llvmlite" in libraries else "camera"
                found[role].append(int(entry.name))
        return found


class AlarmFollower:
    """`lumpwatch alarms --json` in a process of its own: an outside subscriber."""

    def __init__(self, config: Path, log: Path) -> None:
        self._log = log
        self._file = log.open("wb")
        self._process = subprocess.Popen(
            [*LUMPWATCH, "alarms", str(config), "--json"],
            stdout=self._file,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )

    def records(self, alarm_class: str | None = "lump") -> list[dict[str, Any]]:
        """Those of one class; None: all."""
        lines = self._log.read_text().splitlines()
        found = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]
        alarms = [one for one in found if one["type"].startswith("io.lumpwatch.alarm.")]
        return [one for one in alarms if alarm_class in (None, one["data"]["class"])]

    def __enter__(self) -> Self:
        return self

    def sleep(self) -> None:
        """Suspend the process: it stays connected and reads nothing."""
        self._process.send_signal(signal.SIGSTOP)

    def wake(self) -> None:
        """Let it go on."""
        self._process.send_signal(signal.SIGCONT)

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=60)
        self._file.close()
