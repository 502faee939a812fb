"""Worker processes for the tests of the supervisor: each has one way to behave."""

from __future__ import annotations

import contextlib
import os
import signal
import struct
import time
from multiprocessing.connection import Connection
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge

from lumpwatch.service.telemetry.daemon_connection import DaemonConnection, Report


def _metrics(registry: CollectorRegistry) -> None:
    """Three events and a level."""
    Counter("worked", "Work done.", ("camera",), registry=registry).labels("cam").inc(3)
    Gauge("level", "How high.", ("camera",), registry=registry).labels("cam").set(0.5)


def good(connection: Connection) -> None:
    """Works until it is told to stop, and reports what it has done since."""
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    _metrics(registry)
    daemon.state = "running"
    daemon.decided["apron"] = time.monotonic()
    while not daemon.wait(0.05):
        pass
    Counter("stopped", "Ends.", registry=registry).inc()
    daemon.state = "stopped"
    daemon.close()


def passing(end: str, connection: Connection) -> None:
    """Works until a file is there and ends by itself; one that starts later goes on."""
    path = Path(end)
    if path.exists():
        good(connection)
        return
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    _metrics(registry)
    while not path.exists():
        daemon.wait(0.05)
    daemon.close()


def failing(connection: Connection) -> None:
    """Ends at once, without a word."""
    raise SystemExit(3)


def hanging(once: str, connection: Connection) -> None:
    """Beats once and hangs, the first time; works the second time."""
    path = Path(once)
    if path.exists():
        good(connection)
        return
    path.touch()
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    _metrics(registry)
    daemon.state = "running"
    daemon.beat()
    time.sleep(600)


def compiling(connection: Connection) -> None:
    """Takes two seconds for its first work, without a beat."""
    registry = CollectorRegistry()
    daemon = DaemonConnection(connection, registry)
    daemon.beat()
    time.sleep(2.0)
    daemon.state = "running"
    while not daemon.wait(0.05):
        pass
    daemon.close()


def deaf(connection: Connection) -> None:
    """Reports, and ignores every wish to stop, on the line and by signals."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    for _ in range(2000):
        with contextlib.suppress(OSError):
            connection.send(Report(time.monotonic(), "", "running"))
        time.sleep(0.05)


def mute(connection: Connection) -> None:
    """Never opens the line at all, and ignores signals."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    time.sleep(600)


def broken_off(connection: Connection) -> None:
    """Sends the beginning of a message and hangs; a length of 1000 bytes, and four of them."""
    os.write(connection.fileno(), struct.pack("!i", 1000) + b"half")
    time.sleep(600)


def stubborn(connection: Connection) -> None:
    """Hears the wish to stop but its main loop does not turn: the link ends the process."""
    DaemonConnection(connection, CollectorRegistry())
    time.sleep(600)
