"""Serves `/metrics`, `/livez`, `/readyz` and `/startupz`."""

from __future__ import annotations

import contextlib
import json
import logging
import socket
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Protocol, Self

from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder

from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.telemetry.older_names import WithOlderNames

log = logging.getLogger(__name__)


class TelemetryError(LumpwatchError):
    """The address cannot be served; the text names it."""


class Health(Protocol):
    """Judges the daemon by its outcome. Each answer lists what is wrong; empty means healthy."""

    def live(self) -> list[str]:
        """Whether the daemon itself works; a restart would help if not."""

    def ready(self) -> list[str]:
        """Whether every ROI has decided lately."""

    def started(self) -> list[str]:
        """Whether every ROI has decided once."""


class TelemetryServer:
    """An HTTP server in threads of its own; a context manager."""

    def __init__(self, address: tuple[str, int], registry: CollectorRegistry, health: Health) -> None:
        """Raises TelemetryError where the address cannot be bound."""

        class Handler(_Handler):
            pass

        Handler.registry = registry
        Handler.health = health
        try:
            self._server = _server_class(address[0])(address, Handler)
        except OSError as error:
            where = f"{address[0]}:{address[1]}"
            raise TelemetryError(f"telemetry.listen {where}: cannot be served ({error.strerror})") from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="telemetry", daemon=True)

    @property
    def url(self) -> str:
        """Where the server really listens."""
        host, port = self._server.server_address[:2]
        return f"http://{host if isinstance(host, str) else host.decode()}:{port}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(timeout=2)


MOST_CONNECTIONS = 32
"""Further ones are closed at once."""
LONGEST_S = 20.0
"""A connection, answers included, ends after this long."""


def _end(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)


def _server_class(host: str) -> type[ThreadingHTTPServer]:
    class Server(ThreadingHTTPServer):
        address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        daemon_threads = True
        request_queue_size = 16

        def __init__(self, *arguments: Any, **named: Any) -> None:
            self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
            super().__init__(*arguments, **named)

        def process_request(self, request: Any, client_address: Any) -> None:
            """In a thread of its own, as long as there are not too many; else the connection is closed."""
            if not self._free.acquire(blocking=False):
                self.shutdown_request(request)
                return
            try:
                super().process_request(request, client_address)
            except BaseException:
                self._free.release()
                raise

        def process_request_thread(self, request: Any, client_address: Any) -> None:
            """Answers one connection, which ends after a while whatever the client does."""
            watch = threading.Timer(LONGEST_S, _end, (request,))
            watch.daemon = True
            try:
                watch.start()
                super().process_request_thread(request, client_address)
            finally:
                watch.cancel()
                self._free.release()

        def handle_error(self, request: Any, client_address: Any) -> None:
            """A client that does odd things is its own problem: not worth a traceback."""
            log.debug("a request from %s failed", client_address, exc_info=True)

    return Server


def _encoder(accept: str) -> tuple[Callable[[Any], bytes], str]:
    """That of the format that is asked for; of the usual one where nobody can tell what is."""
    try:
        return choose_encoder(accept)
    except (TypeError, ValueError):
        return choose_encoder("")


class _Handler(BaseHTTPRequestHandler):
    registry: CollectorRegistry
    health: Health
    timeout = 10  # a client that sends nothing does not keep a thread for ever

    def do_GET(self) -> None:
        """Answer one request."""
        path = self.path.partition("?")[0]
        if path == "/metrics":
            encode, content_type = _encoder(self.headers.get("Accept", ""))
            self._answer(HTTPStatus.OK, encode(WithOlderNames(self.registry)), content_type)
            return
        checks = {"/livez": self.health.live, "/readyz": self.health.ready, "/startupz": self.health.started}
        if (check := checks.get(path)) is None:
            self._answer(HTTPStatus.NOT_FOUND, b"try /metrics, /livez, /readyz or /startupz\n", "text/plain")
            return
        problems = check()
        status = HTTPStatus.SERVICE_UNAVAILABLE if problems else HTTPStatus.OK
        body = json.dumps({"ok": not problems, "problems": problems}).encode() + b"\n"
        self._answer(status, body, "application/json")

    def _answer(self, status: HTTPStatus, body: bytes, content_type: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", content_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # who asked has gone: a scrape that took too long
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Scrapes come every few seconds; they are not worth a line each."""
