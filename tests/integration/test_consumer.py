"""The reference consumer as a process of its own, against a real daemon that fails in all ways."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Self

import pytest

from lumpwatch.service.config import load_config
from tests.integration.site import wait_for
from tests.integration.test_alarm_life import running

pytestmark = pytest.mark.slow

CONSUMER = Path(__file__).parents[2] / "deploy" / "consumer" / "consumer.py"
PATIENCE_S = 40.0


class Link:
    """A TCP connection that can be cut: bytes are held back in both directions, nothing is closed."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._open = threading.Event()
        self._open.set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        self._open.clear()

    def mend(self) -> None:
        self._open.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.mend()
        for one in (self._listener, *self._sockets):
            one.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
            except OSError:
                if self._listener.fileno() < 0:
                    return
                near.close()
                continue
            self._sockets += [near, far]
            for one, other in ((near, far), (far, near)):
                threading.Thread(target=self._pass, args=(one, other), daemon=True).start()

    def _pass(self, one: socket.socket, other: socket.socket) -> None:
        try:
            while data := one.recv(65536):
                self._open.wait()
                other.sendall(data)
        except OSError:
            pass
        for end in (one, other):
            end.close()


class Consumer:
    """The process, and what it has printed."""

    def __init__(self, port: int, log: Path) -> None:
        self._log = log
        self._file = log.open("wb")
        # Neither the repository nor its packages are on its path.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(CONSUMER), f"tcp/127.0.0.1:{port}", "test", "cam", "apron"],
            stdout=self._file,
            stderr=subprocess.STDOUT,
            env=environment,
            cwd=log.parent,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.poll() is None, self._log.read_text()
        self._process.terminate()
        self._process.wait(timeout=10)
        self._file.close()
        print(self._log.read_text())

    @property
    def lines(self) -> list[str]:
        return self._log.read_text().splitlines()

    def wait(self, what: str, after: int = 0) -> list[str]:
        """The lines since the number `after`, once the last of them starts with `what`."""

        def there() -> list[str] | None:
            lines = self.lines[after:]
            return lines if lines and lines[-1].startswith(what) else None

        found: list[str] = wait_for(f"consumer says {what}", there, PATIENCE_S)
        return found


def test_it_is_safe_from_the_start_and_whenever_it_hears_nothing(tmp_path: Path) -> None:
    with running(tmp_path, latch=False) as site:
        port = int(load_config(site.daemon.config).bus.listen[0].rpartition(":")[2])
        with Link(port) as link:
            link.cut()
            with Consumer(link.port, tmp_path / "consumer.log") as consumer:
                assert consumer.wait("SAFE") == ["SAFE: starting"]
                link.mend()
                consumer.wait("CLEAR")
                site.feed.bright = True
                consumer.wait("LUMP")
                site.feed.bright = False
                consumer.wait("CLEAR")

                seen = len(consumer.lines)
                link.cut()  # partition: neither side is told
                assert consumer.wait("SAFE", seen)[0].endswith("expired")
                link.mend()
                consumer.wait("CLEAR")

                seen = len(consumer.lines)
                (monitor,) = site.daemon.children()["monitor"]
                os.kill(monitor, signal.SIGSTOP)
                assert consumer.wait("SAFE", seen)[0].endswith("expired")
                os.kill(monitor, signal.SIGCONT)
                consumer.wait("CLEAR")

                seen = len(consumer.lines)
                site.feed.frozen = True  # decisions stop though the monitor lives
                assert consumer.wait("SAFE", seen)[0] in ("SAFE: blind", "SAFE: heartbeat says invalid")
                site.feed.frozen = False
                consumer.wait("CLEAR")

                seen = len(consumer.lines)
                os.kill(monitor, signal.SIGKILL)
                assert consumer.wait("SAFE", seen)[0] == "SAFE: liveliness token gone"
                consumer.wait("CLEAR")

                seen = len(consumer.lines)
                assert site.daemon.process is not None
                site.killed = True
                site.daemon.process.kill()
                site.daemon.process.wait()
                consumer.wait("SAFE", seen)


def test_it_is_small_and_stands_alone() -> None:
    text = CONSUMER.read_text()
    assert "service" not in text.replace("lumpwatch/v1", "")
    assert len([line for line in text.splitlines() if line.strip()]) < 50
