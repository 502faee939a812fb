"""What the demo starts beside the daemon: console and gateway, each in a process of its own.

Such a process imports this module first, so whatever is large is imported where it is needed.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from rich.console import Console

from lumpwatch.service.config import BusConfig, SiteConfig

_START_S = 60.0


class Beside:
    """A client of the bus in a process of its own, as its command would be."""

    serve: Callable[[SiteConfig, Path, Connection], None]
    """Runs in that process: says by the connection how it can be reached, and ends when the connection does."""
    shown: str
    """The line that is printed, with what the process said in the place of `{}`."""

    def __init__(self, config: SiteConfig, file: Path, hub: tuple[str, ...], console: Console) -> None:
        bus = BusConfig(mode="client", connect=hub)
        ours, theirs = multiprocessing.get_context("spawn").Pipe()
        self._connection = ours
        self._process = multiprocessing.get_context("spawn").Process(
            target=type(self).serve, args=(config.model_copy(update={"bus": bus}), file, theirs)
        )
        self._process.start()
        theirs.close()
        # The daemon does not wait for it: its cameras start meanwhile.
        self._told = threading.Thread(target=self._tell, args=(console,), name="tell", daemon=True)
        self._told.start()

    def _tell(self, console: Console) -> None:
        try:
            said = self._connection.recv() if self._connection.poll(_START_S) else "does not start"
        except (EOFError, OSError):
            said = "has ended"
        console.print(self.shown.format(said), soft_wrap=True)

    def close(self) -> None:
        """End it; it also ends by itself when this process is gone."""
        self._told.join(timeout=_START_S)
        self._connection.close()
        self._process.join(timeout=10.0)
        if self._process.is_alive():
            self._process.kill()


def _until_closed(connection: Connection) -> threading.Event:
    """Set when the other end of the connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the demo says when it ends
    stop = threading.Event()

    def wait() -> None:
        with contextlib.suppress(EOFError, OSError):
            connection.recv()
        stop.set()

    threading.Thread(target=wait, name="end", daemon=True).start()
    return stop


def _serve_page(config: SiteConfig, file: Path, connection: Connection) -> None:
    stop = _until_closed(connection)
    try:
        from lumpwatch.service.console import run_console
    except ModuleNotFoundError as error:
        connection.send(f"needs {error.name}: pip install 'lumpwatch[service,console]'")
        return
    run_console(config, file, stop, connection.send)


def _serve_gateway(config: SiteConfig, file: Path, connection: Connection) -> None:
    from lumpwatch.service.gateway import GatewayError, run_gateway

    stop = _until_closed(connection)
    try:
        run_gateway(config, stop, lambda served: connection.send(served["modbus"]))
    except GatewayError as error:
        connection.send(str(error))


class Page(Beside):
    """The operator's console."""

    serve = staticmethod(_serve_page)
    shown = "console  [bold]{}[/bold]   (open it in a browser; A acknowledges)"


class Gateway(Beside):
    """The gateway to a PLC."""

    serve = staticmethod(_serve_gateway)
    shown = "modbus   [bold]{}[/bold]   (for a PLC; `lumpwatch gateway site.yaml --map` prints the registers)"
