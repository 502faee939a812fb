"""Start a test server as a process of its own, talk to it, stop it, kill it."""

from __future__ import annotations

import select
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

_ROOT = Path(__file__).resolve().parents[2]
_START_DEADLINE_S = 30.0


class ServerProcess:
    """A server that prints its URL on the first line of stdout; a context manager."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(
            command, cwd=_ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._process.stdout
        ready, _, _ = select.select([self._process.stdout], [], [], _START_DEADLINE_S)
        self.url = self._process.stdout.readline().strip() if ready else ""
        if not self.url.startswith(("rtsp://", "rtsps://")):
            self.kill()
            raise RuntimeError(f"the server did not start: {self.url or 'no answer'}")

    @property
    def port(self) -> int:
        """The TCP port that the server listens on."""
        port = urlsplit(self.url).port
        assert port is not None
        return port

    def say(self, line: str) -> None:
        """Send one line of the server's control language."""
        assert self._process.stdin
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def stop(self) -> None:
        """Suspend the process: connections stay open, nothing moves."""
        self._process.send_signal(signal.SIGSTOP)

    def cont(self) -> None:
        """Resume the process."""
        self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End the process at once; idempotent."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe:
                pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()


class RtspServer(ServerProcess):
    """Our own server (`tests.servers.rtsp_mini`), by default on 127.0.0.1; port 0 takes a free one."""

    def __init__(
        self,
        video: Path,
        port: int = 0,
        *,
        host: str = "127.0.0.1",
        user: str | None = None,
        password: str | None = None,
        run_by: tuple[str, ...] = (),
        more: tuple[str, ...] = (),
    ) -> None:
        """`run_by` is a command that runs the server, such as one that enters a network namespace; `more` are further
        options of it."""
        command = [*run_by, sys.executable, "-m", "tests.servers.rtsp_mini", str(video)]
        command += ["--host", host, "--port", str(port)]
        if user is not None:
            command += ["--user", user, "--password", password or ""]
        command += more
        super().__init__(command)


_SYSTEM_PYTHON = "/usr/bin/python3"
_GST_SCRIPT = str(Path(__file__).with_name("gst_server.py"))


class GstServer(ServerProcess):
    """GStreamer's RTSP server; plays the file once for each client."""

    def __init__(self, video: Path, codec: str) -> None:
        super().__init__([_SYSTEM_PYTHON, _GST_SCRIPT, codec, str(video)])


def gst_missing() -> str | None:
    """Why the GStreamer server cannot be started; None where it can."""
    try:
        check = subprocess.run(
            [_SYSTEM_PYTHON, _GST_SCRIPT, "--check"], capture_output=True, text=True, timeout=60, check=False
        )
    except OSError:
        return f"{_SYSTEM_PYTHON} is not there"
    last = (check.stderr.strip() or "failed").splitlines()[-1]
    return f"GStreamer RTSP server: {last}" if check.returncode else None
