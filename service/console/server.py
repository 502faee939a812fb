"""The console's process: a client of the bus, and a web server."""

from __future__ import annotations

import contextlib
import logging
import socket
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import uvicorn
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.config import BusConfig, SiteConfig
from lumpwatch.service.console.api import LiveApi
from lumpwatch.service.console.board import Board
from lumpwatch.service.console.clip_api import ClipApi
from lumpwatch.service.console.clips import Clips
from lumpwatch.service.console.context import Context
from lumpwatch.service.console.edit_api import EditApi
from lumpwatch.service.console.guard import Guard
from lumpwatch.service.console.pictures import Pictures
from lumpwatch.service.console.sessions import Sessions, Throttle
from lumpwatch.service.console.stream import Stream
from lumpwatch.service.console.times import SiteTimes
from lumpwatch.service.console.users import UserFile
from lumpwatch.service.console.views import Views
from lumpwatch.service.console.work import Workshop, open_workshop
from lumpwatch.service.console.work_api import WorkApi
from lumpwatch.service.errors import LumpwatchError

log = logging.getLogger(__name__)


class ConsoleError(LumpwatchError):
    """The console cannot be served."""


def run_console(
    config: SiteConfig,
    path: Path,
    stop: threading.Event,
    on_ready: Callable[[str], None] = lambda _: None,
) -> None:
    """Serve until `stop` is set; `on_ready` gets the address. Raises ConsoleError where it cannot listen.

    `path` is the configuration file, which engineers change. The page comes up whether the bus is there or
    not, and says that it is silent.
    """
    listening = _listen(config)
    with contextlib.ExitStack() as stack:
        stack.callback(listening.close)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="lumpwatch-console-")))
        bus = stack.enter_context(open_client(_as_client(config), stop))
        bus.alive(Keys(config.site).alive("console", config.site))
        workshop = open_workshop(config, path)
        stack.callback(workshop.close)
        app = make_app(config, path, bus, folder, workshop)
        tls = config.console.tls
        settings = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=1,
            limit_concurrency=500,
            ssl_certfile=tls.certificate if tls else None,
            ssl_keyfile=tls.key if tls else None,
        )
        server = uvicorn.Server(settings)
        failed: list[BaseException] = []

        def serve() -> None:
            try:
                server.run([listening])
            except BaseException as error:
                failed.append(error)

        serving = threading.Thread(target=serve, name="console", daemon=True)
        serving.start()
        scheme = "https" if config.console.tls else "http"
        host, port = listening.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        while not server.started and serving.is_alive():
            stop.wait(0.02)
        if serving.is_alive():
            on_ready(f"{scheme}://{shown}:{port}")
        while serving.is_alive() and not stop.wait(0.2):
            pass
        server.should_exit = True
        serving.join(timeout=5.0)
        if failed:
            raise ConsoleError(f"console: {failed[0]}")


def make_app(config: SiteConfig, path: Path, bus: Bus, folder: Path, workshop: Workshop) -> ASGIApp:
    """The application; `folder` takes what is made for browsers."""
    board = Board(config)
    board.follow(bus)
    users = UserFile(config.console.users) if config.console.users else None
    sessions = Sessions(config.console.session_s)
    templates = Environment(
        loader=PackageLoader("lumpwatch.service.console", "pages"), autoescape=True, undefined=StrictUndefined
    )
    context = Context(
        config=config,
        path=path,
        bus=bus,
        board=board,
        pictures=Pictures(bus, board),
        clips=Clips(bus, config.site, folder / "clips", config.console.clips_mb << 20),
        stream=Stream(board.snapshot, lambda: (board.version, board.alarm_version)),
        sessions=sessions,
        throttle=Throttle(),
        users=users,
        templates=templates,
        times=SiteTimes(config),
        workshop=workshop,
    )
    parts = (Views, LiveApi, EditApi, ClipApi, WorkApi)
    app = Starlette(routes=[route for part in parts for route in part(context).routes()])
    app.mount("/static", StaticFiles(packages=[("lumpwatch.service.console", "static")]), name="static")
    app.state.guard = guard = Guard(app, config.console, sessions, users)
    return guard


def _as_client(config: SiteConfig) -> BusConfig:
    """How the console joins the bus: by its own certificate where it has one."""
    tls = config.console.bus_tls or config.bus.tls
    return config.bus.model_copy(
        update={"mode": "client", "connect": config.bus.joined, "listen": (), "tls": tls, "access": None}
    )


def _listen(config: SiteConfig) -> socket.socket:
    host, port = config.console.address
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(128)
    except OSError as error:
        raise ConsoleError(f"console: cannot listen on {config.console.listen} ({error.strerror})") from error
    return listening
