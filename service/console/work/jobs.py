"""Long work in a process of its own, one after the other: the page may go, the queue goes on.

    <store>/console/jobs/<id>/job.json      what was ordered, by whom, and how it went
    <store>/console/jobs/<id>/…             its log and what came of it

Each job is a `lumpwatch` command as a person would give it, with low priority and one thread, so that it leaves the
cores to the filter. A console that ends ends the job that runs; what waited then waits again after the start.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage import replace_file

log = logging.getLogger(__name__)

State = Literal["queued", "running", "done", "failed", "cancelled", "interrupted"]
OVER: tuple[State, ...] = ("done", "failed", "cancelled", "interrupted")
_MOST_QUEUED = 20
_KEPT = 100
_PATIENCE_S = 5.0
_PROGRESS, _LOG, _ABOUT = "progress.json", "log.txt", "job.json"
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_TAIL = 20_000


class JobError(LumpwatchError):
    """Work that cannot be taken or found; the text says why."""


class Job(BaseModel):
    """A piece of work."""

    model_config = ConfigDict(extra="forbid")

    id: str
    kind: str
    order: dict[str, Any]
    about: str
    """In words."""
    by: str
    asked: datetime
    state: State = "queued"
    began: datetime | None = None
    ended: datetime | None = None
    said: str = ""
    """The last line of what it said where it failed."""
    pid: int | None = None
    """Its process while it runs, which is the leader of its group."""


class Queue:
    """The jobs below one folder; `command` puts together what runs, `done` takes what came of it."""

    def __init__(
        self,
        folder: Path,
        most_bytes: int,
        command: Callable[[Job, Path], Sequence[str]],
        done: Callable[[Job, Path], None],
    ) -> None:
        self._folder = folder
        self._most = most_bytes
        self._command = command
        self._done = done
        self._changed = threading.Condition()
        self._jobs: dict[str, Job] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._running: str | None = None
        self._closed = False
        self._thread: threading.Thread | None = None
        self._load()

    def jobs(self) -> list[Job]:
        """All, newest first."""
        with self._changed:
            return [
                job.model_copy() for job in sorted(self._jobs.values(), key=lambda job: job.id, reverse=True)
            ]

    def job(self, name: str) -> Job:
        """One. Raises KeyError."""
        with self._changed:
            if name not in self._jobs:
                raise KeyError(f"job {name[:40]}")
            return self._jobs[name].model_copy()

    def folder(self, name: str) -> Path:
        """Where its results lie. Raises KeyError."""
        return self._folder / self.job(name).id

    def progress(self, name: str) -> dict[str, Any] | None:
        """How far the running stage is: `stage`, `done`, `total`. Raises KeyError."""
        try:
            found = json.loads((self.folder(name) / _PROGRESS).read_bytes())
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def log(self, name: str) -> str:
        """The end of what it said. Raises KeyError."""
        try:
            with (self.folder(name) / _LOG).open("rb") as file:
                file.seek(max(0, file.seek(0, 2) - _TAIL))
                return file.read().decode("utf-8", "replace")
        except OSError:
            return ""

    def put(self, kind: str, order: dict[str, Any], about: str, by: str) -> Job:
        """Queue a job. Raises JobError."""
        now = datetime.now(UTC)
        job = Job(
            id=f"{now:%Y%m%dT%H%M%S%f}-{secrets.token_hex(2)}", kind=kind, order=order, about=about, by=by, asked=now
        )  # fmt: skip
        with self._changed:
            if sum(one.state not in OVER for one in self._jobs.values()) >= _MOST_QUEUED:
                raise JobError(f"{_MOST_QUEUED} jobs wait already: cancel some")
            try:
                (self._folder / job.id).mkdir(parents=True)
                self._write(job)
            except OSError as error:
                raise JobError(f"{self._folder}: cannot be written ({error.strerror})") from error
            self._jobs[job.id] = job
            self._start()
            self._changed.notify_all()
        log.warning("%s ordered %s: %s", by, kind, about)
        return job.model_copy()

    def cancel(self, name: str, by: str) -> Job:
        """End a job, or keep it from beginning. Raises KeyError."""
        with self._changed:
            if name not in self._jobs:
                raise KeyError(f"job {name[:40]}")
            job = self._jobs[name]
            if job.state not in OVER:
                job.said = f"cancelled by {by}"
                self._set(job, "cancelled")
                if self._running == name:
                    self._end()
            return job.model_copy()

    def remove(self, name: str) -> None:
        """Remove a job that is over, with its results. Raises KeyError, JobError."""
        with self._changed:
            if name not in self._jobs:
                raise KeyError(f"job {name[:40]}")
            if self._jobs[name].state not in OVER or self._running == name:
                raise JobError("the job is not over: cancel it first")
            self._drop(name)

    def close(self) -> None:
        """End what runs; what waits stays in the queue."""
        with self._changed:
            self._closed = True
            if self._running is not None and self._jobs[self._running].state == "running":
                self._jobs[self._running].said = "the console ended"
                self._set(self._jobs[self._running], "interrupted")
            self._end()
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(_PATIENCE_S + 1)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._waiting())
                if self._closed:
                    return
                job = self._jobs[self._waiting()[0]]
                self._running = job.id
                job.began = datetime.now(UTC)
                self._set(job, "running")
            try:
                self._work(job)
            finally:
                with self._changed:
                    self._running = None
                    if job.state == "running":
                        self._set(job, "failed")
                    self._prune()
                    self._changed.notify_all()

    def _work(self, job: Job) -> None:
        folder = self._folder / job.id
        try:
            arguments = self._command(job.model_copy(), folder)
            code = self._ran(job, arguments, folder)
            if code == 0:
                self._done(job.model_copy(), folder)
        except KeyError as error:
            self._over(job, "failed", f"{error.args[0]}: is not there any more")
        except (LumpwatchError, OSError) as error:
            self._over(job, "failed", str(error))
        else:
            lines = [] if code == 0 else self.log(job.id).strip().splitlines()
            self._over(job, "done" if code == 0 else "failed", lines[-1][:500] if lines else "")

    def _ran(self, job: Job, arguments: Sequence[str], folder: Path) -> int:
        words = [sys.executable, "-m", "lumpwatch.service.cli", *arguments]
        environment = {
            **os.environ, **dict.fromkeys(_ONE_THREAD, "1"),
            "LUMPWATCH_PROGRESS": str(folder / _PROGRESS), "COLUMNS": "110",
        }  # fmt: skip
        with (folder / _LOG).open("wb") as said:
            with self._changed:
                if job.state != "running":
                    return 1
                process = self._process = subprocess.Popen(
                    ["nice", "-n", "10", *words],
                    stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=environment, start_new_session=True,
                )  # fmt: skip
                job.pid = process.pid
                self._set(job, "running")
            try:
                return process.wait()
            finally:
                with self._changed:
                    self._process = None
                (folder / _PROGRESS).unlink(missing_ok=True)

    def _end(self) -> None:
        """End the process that runs, and all that it has started; by force where it does not end."""
        process = self._process
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        killer = threading.Timer(_PATIENCE_S, _kill, (process,))
        killer.daemon = True
        killer.start()

    def _waiting(self) -> list[str]:
        return sorted(job.id for job in self._jobs.values() if job.state == "queued")

    def _over(self, job: Job, state: State, said: str) -> None:
        with self._changed:
            if job.state == "running":
                job.said = said
                self._set(job, state)

    def _set(self, job: Job, state: State) -> None:
        job.state = state
        if state in OVER:
            job.ended, job.pid = datetime.now(UTC), None
        try:
            self._write(job)
        except OSError as error:  # what counts is in memory; after a restart it is what the file says
            log.warning("%s: cannot be written (%s)", self._folder / job.id, error.strerror)

    def _write(self, job: Job) -> None:
        replace_file(self._folder / job.id / _ABOUT, job.model_dump_json(indent=1).encode())

    def _load(self) -> None:
        for path in sorted(self._folder.glob(f"*/{_ABOUT}")):
            try:
                job = Job.model_validate_json(path.read_bytes())
            except (OSError, ValidationError) as error:
                log.warning("%s: is left out (%s)", path, str(error).splitlines()[0])
                continue
            self._jobs[job.id] = job
            if job.state == "running":  # that console was killed, and could neither say so nor end the job
                _end_orphan(job, self._folder / job.id)
                job.said = "the console ended"
                self._set(job, "interrupted")
        if self._waiting():
            self._start()

    def _start(self) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="jobs", daemon=True)
            self._thread.start()

    def _prune(self) -> None:
        """Remove the oldest jobs that are over, down to a number and a size."""
        over = sorted(job.id for job in self._jobs.values() if job.state in OVER)
        sizes = {name: _size(self._folder / name) for name in over}
        total = sum(sizes.values())
        for i, name in enumerate(over[:-1]):
            if total <= self._most and len(over) - i <= _KEPT:
                break
            total -= sizes[name]
            self._drop(name)

    def _drop(self, name: str) -> None:
        del self._jobs[name]
        shutil.rmtree(self._folder / name, ignore_errors=True)


def _kill(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _end_orphan(job: Job, folder: Path) -> None:
    """End what a console that was killed has left, if the process of that number is still the same."""
    with contextlib.suppress(OSError):
        if job.pid and f"LUMPWATCH_PROGRESS={folder / _PROGRESS}".encode() in Path(
            f"/proc/{job.pid}/environ"
        ).read_bytes().split(b"\0"):
            os.killpg(job.pid, signal.SIGKILL)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.glob("*") if path.is_file())
