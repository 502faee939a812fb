"""Cameras that fail again and again: does anything grow?

`python -m tests.faults.long_run --minutes 60 --cameras 4`

A daemon watches so many cameras (our own RTSP server each); every minute one of them fails in the next way. Between
faults, when all decide again, memory, file handles, threads, shared memory, disk and latency are measured; at the end
they must be what they were after the first quarter, within the limits below. A fault from which the daemon does not
come back by itself ends the run.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from itertools import chain
from pathlib import Path
from statistics import median

from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from tests.integration.site import Daemon, wait_for
from tests.memory import pss_kib
from tests.servers.process import RtspServer

BACK_S = 60.0
"""Within that all cameras must decide again."""
_PERIOD_S = 60.0
_CLIP_S = 10.0
_LATENCY = "lumpwatch_frame_to_decision_seconds"


@dataclass(frozen=True, slots=True)
class Held:
    """What the daemon and its processes hold."""

    memory_mb: float
    """Proportional set size, so that what processes share counts once."""
    handles: float
    threads: float
    processes: float
    shared_mb: float
    """Of the whole machine's /dev/shm."""
    disk_mb: float
    """Of the store."""
    latency_ms: float
    """From capture to publication, mean since the last look."""


GROWTH = Held(
    memory_mb=0.10, handles=0.10, threads=0.10, processes=0.0, shared_mb=0.0, disk_mb=0.0, latency_ms=0.5
)
"""How much more may be held at the end, as a share."""
SPARE = Held(memory_mb=30.0, handles=8, threads=4, processes=0, shared_mb=64.0, disk_mb=20.0, latency_ms=30.0)
"""And on top of that."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A way to fail, and to be well again."""

    name: str
    begin: Callable[[RtspServer], None]
    end: Callable[[RtspServer], None] = lambda _: None


FAULTS = (
    Fault("connections closed", lambda server: server.say("kick")),
    Fault("picture freezes", lambda server: server.say("freeze"), lambda server: server.say("thaw")),
    Fault("damaged pictures", lambda server: server.say("corrupt 20")),
    Fault("server suspended", lambda server: server.stop(), lambda server: server.cont()),
    Fault("time stamps jump", lambda server: server.say("back 30")),
    Fault("lost pictures", lambda server: server.say("drop 40")),
)


def run(minutes: float, cameras: int, folder: Path, period_s: float = _PERIOD_S) -> list[Held]:
    """What was held, look by look. Raises AssertionError where the daemon does not come back."""
    video = write_video(FeedSpec(width=320, height=240, seed=1), _CLIP_S, folder).video
    with ExitStack() as stack:
        servers = [stack.enter_context(RtspServer(video)) for _ in range(cameras)]
        daemon = stack.enter_context(
            Daemon(folder, "".join(_camera(k, one) for k, one in enumerate(servers)))
        )
        wait_for("ready", lambda: daemon.ready, 120.0 + 30.0 * cameras)
        end, looks, turn = time.monotonic() + 60.0 * minutes, [], 0
        decided, look = _Decided(daemon, cameras), Look(daemon)
        while time.monotonic() < end:
            began = time.monotonic()
            fault, victim = FAULTS[turn % len(FAULTS)], servers[(turn // len(FAULTS) + turn) % cameras]
            fault.begin(victim)
            time.sleep(min(5.0, period_s / 4))  # a fault lasts
            fault.end(victim)
            decided.mark()
            wait_for(f"back after: {fault.name}", lambda: decided.again() and daemon.ready, BACK_S)
            looks.append(look())
            print(
                f"{turn + 1:4} {fault.name:20} back after {time.monotonic() - began:5.1f} s  {_shown(looks[-1])}"
            )
            sys.stdout.flush()
            turn += 1
            time.sleep(max(0.0, min(began + period_s, end) - time.monotonic()))
    return looks


class _Decided:
    """Whether every camera has decided again."""

    def __init__(self, daemon: Daemon, cameras: int) -> None:
        self._daemon, self._names = daemon, [f"cam-{k}" for k in range(cameras)]
        self._at: list[float] = []

    def mark(self) -> None:
        self._at = self._counts()

    def again(self) -> bool:
        return all(now > then + 5 for now, then in zip(self._counts(), self._at, strict=True))

    def _counts(self) -> list[float]:
        return [self._daemon.metric("lumpwatch_frames_processed_total", camera=name) for name in self._names]


class Look:
    """Looks at what is held now."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._latency = 0.0, 0.0

    def __call__(self) -> Held:
        """Now; the latency is that of the decisions since the last time."""
        daemon = self._daemon
        assert daemon.process is not None
        processes = [daemon.process.pid, *chain.from_iterable(daemon.children().values())]
        memory = handles = threads = 0.0
        for process in processes:
            proc = Path("/proc") / str(process)
            memory += pss_kib(process) / 1024
            handles += len(list((proc / "fd").iterdir()))
            threads += len(list((proc / "task").iterdir()))
        total = daemon.metric(f"{_LATENCY}_sum"), daemon.metric(f"{_LATENCY}_count")
        spent, many = (now - before for now, before in zip(total, self._latency, strict=True))
        if many <= 0:  # a monitor that was started anew counts from 0
            spent, many = total
        self._latency = total
        return Held(
            memory,
            handles,
            threads,
            len(processes),
            _size(Path("/dev/shm")),
            _size(daemon.folder / "var"),
            1000.0 * spent / max(many, 1.0),
        )


def grown(looks: Sequence[Held]) -> list[str]:
    """What is more at the end than after the first quarter, beyond the limits; medians of a quarter each."""
    quarter = max(len(looks) // 4, 1)
    early, late = looks[quarter : 2 * quarter] or looks[:1], looks[-quarter:]
    told = []
    for field in fields(Held):
        before, after = (median(getattr(one, field.name) for one in part) for part in (early, late))
        if after > before * (1.0 + getattr(GROWTH, field.name)) + getattr(SPARE, field.name):
            told.append(f"{field.name}: {before:.1f} to {after:.1f}")
    return told


def _shown(held: Held) -> str:
    return "  ".join(f"{field.name} {getattr(held, field.name):.0f}" for field in fields(Held))


def _size(folder: Path) -> float:
    return (
        sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
        if folder.exists()
        else 0.0
    )


def _camera(k: int, server: RtspServer) -> str:
    return f"""\
  - id: cam-{k}
    source: {{url: "{server.url}", read_timeout_s: 2}}
    rois:
      - {{id: belt, polygon: [[0.15, 0.1], [0.85, 0.1], [0.85, 0.95], [0.15, 0.95]], detector: {{particles: 500}}}}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, and say what has grown."""
    parser = argparse.ArgumentParser("python -m tests.faults.long_run", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--period", type=float, default=_PERIOD_S, help="seconds from fault to fault")
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="lumpwatch-long-") as folder:
        looks = run(asked.minutes, asked.cameras, Path(folder), asked.period)
    if told := grown(looks):
        sys.exit(f"has grown: {'; '.join(told)}")
    print(f"{len(looks)} faults, nothing has grown")


if __name__ == "__main__":
    main()
