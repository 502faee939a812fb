"""What the tests of the bus share: free ports, patience, and child processes with one role each.

`python -m tests.bus.test_bus_support ROLE ENDPOINT ...` runs a role; a child says `ready` when it is, and
ends when its standard input ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lumpwatch.service.bus.session import open_client, open_hub
from lumpwatch.service.config.bus import BusConfig
from lumpwatch.service.core.frame import Frame

PATIENCE_S = 30.0


def free_endpoint() -> str:
    """A loopback endpoint that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def hub_config(endpoint: str, *, shared_memory: bool = True) -> BusConfig:
    return BusConfig(listen=(endpoint,), shared_memory=shared_memory, insecure=True)


def client_config(endpoint: str, *, shared_memory: bool = True) -> BusConfig:
    return BusConfig(mode="client", connect=(endpoint,), shared_memory=shared_memory)


def eventually(condition: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
    """Wait until the condition holds; fail when it does not in a generous time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "what was waited for did not come"
        time.sleep(0.01)


def repeat(action: Callable[[], None], until: Callable[[], object]) -> None:
    """Do it again and again, for what only counts once others listen, until the condition holds."""

    def step() -> bool:
        action()
        return bool(until())

    eventually(step)


def gray(seq: int, width: int = 64, height: int = 48) -> Frame:
    """A gray frame of which every pixel is the sequence number modulo 256."""
    now = time.monotonic()
    data = np.full((height, width), seq % 256, np.uint8)
    return Frame(seq, now, now, time.time(), width, height, "gray8", data)


class Child:
    """A process with a role; use as a context manager, which kills it."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.bus.test_bus_support", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
        )
        assert self.line() == "ready"

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def line(self) -> str:
        """The next line that it prints."""
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE_S)
        assert ready, "the child said nothing"
        return self.process.stdout.readline().decode().strip()

    def finish(self) -> dict[str, float]:
        """End its input and return its report."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        report: dict[str, float] = json.loads(self.line())
        return report


def _input_ended() -> bool:
    readable, _, _ = select.select([sys.stdin], [], [], 0)
    return bool(readable) and os.read(sys.stdin.fileno(), 1) == b""


def _hub(endpoint: str) -> None:
    with open_hub(hub_config(endpoint)):
        print("ready", flush=True)
        while not _input_ended():
            time.sleep(0.02)


def _camera(endpoint: str, key: str, memory: str, width: str, height: str, fps: str) -> None:
    """Publish frames until told to stop; report how many, and the longest time that one took."""
    with open_client(client_config(endpoint, shared_memory=memory == "shm")) as bus:
        publisher = bus.frame_publisher(key)
        print("ready", flush=True)
        sent, longest_s = 0, 0.0
        while not _input_ended():
            frame = gray(sent, int(width), int(height))
            publisher.publish(frame)
            longest_s = max(longest_s, time.monotonic() - frame.capture_s)
            sent += 1
            time.sleep(1 / float(fps))
        print(json.dumps({"sent": sent, "longest_s": longest_s}), flush=True)


def _monitor(endpoint: str, key: str, memory: str, pause_s: str) -> None:
    """Take frames, pausing after each; report counts, order, age and memory."""
    with open_client(client_config(endpoint, shared_memory=memory == "shm")) as bus:
        inbox = bus.frame_inbox(key)
        print("ready", flush=True)
        seqs: list[int] = []
        wrong, shared, other_clock, before_kb = 0, 0, 0, 0
        ages: list[float] = []
        while not _input_ended():
            if (frame := inbox.take(0.1)) is None:
                continue
            ages.append(time.monotonic() - frame.capture_s)
            seqs.append(frame.seq)
            wrong += not bool((frame.data == frame.seq % 256).all())
            shared += bool(inbox.through_shared_memory)
            other_clock += not inbox.same_clock
            before_kb = before_kb or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            time.sleep(float(pause_s))
        report = {
            "taken": len(seqs),
            "first": seqs[0] if seqs else -1,
            "last": seqs[-1] if seqs else -1,
            "ordered": seqs == sorted(set(seqs)),
            "wrong": wrong,
            "shared": shared,
            "other_clock": other_clock,
            "skipped": inbox.skipped,
            "median_age_s": float(np.median(ages)) if ages else -1.0,
            "grown_kb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb,
        }
        print(json.dumps(report), flush=True)


def _abandon(endpoint: str, key: str) -> None:
    """Leave a busy session without closing it."""
    bus = open_client(client_config(endpoint))
    bus.subscribe(key, lambda _key, _payload: time.sleep(0.01))
    bus.serve(f"{key}/query", lambda _parameters, _payload: b"")
    bus.frame_inbox(key)
    bus.publisher(f"{key}/state").put(b"1")
    print("ready", flush=True)
    while not _input_ended():
        time.sleep(0.02)


def _listen(endpoint: str, selector: str, sessions: str = "1") -> None:
    """Subscribe to everything and forget it, in so many sessions."""
    with contextlib.ExitStack() as stack:
        for _ in range(int(sessions)):
            bus = stack.enter_context(open_client(client_config(endpoint)))
            bus.subscribe(selector, lambda _key, _payload: None)
        print("ready", flush=True)
        while not _input_ended():
            time.sleep(0.02)


if __name__ == "__main__":
    roles: dict[str, Callable[..., None]] = {
        "hub": _hub,
        "camera": _camera,
        "monitor": _monitor,
        "abandon": _abandon,
        "listen": _listen,
    }
    roles[sys.argv[1]](*sys.argv[2:])
