"""A reverse proxy that says who the user is, as one with OpenID Connect in front of the console would."""

from __future__ import annotations

import http.client
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

FROM = "127.0.0.2"
"""The address that it calls the console from."""
_HOP = frozenset({"connection", "transfer-encoding", "keep-alive"})


class ReverseProxy:
    """Forwards everything to one host; what browsers say of the user is taken out and its own word put in."""

    def __init__(self, target: str, user: str, groups: str) -> None:
        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def forward(self) -> None:
                upstream = http.client.HTTPConnection(target, timeout=30, source_address=(FROM, 0))
                length = int(self.headers.get("Content-Length", "0"))
                headers = {
                    name: value
                    for name, value in self.headers.items()
                    if name.lower() not in _HOP and not name.lower().startswith("x-forwarded-")
                }
                headers |= {"X-Forwarded-User": user, "X-Forwarded-Groups": groups}
                try:
                    upstream.request(self.command, self.path, self.rfile.read(length), headers)
                    answer = upstream.getresponse()
                    self.send_response_only(answer.status)
                    for name, value in answer.getheaders():
                        if name.lower() not in _HOP:
                            self.send_header(name, value)
                    self.send_header("Connection", "close")
                    self.end_headers()
                    while piece := answer.read1(65536):
                        self.wfile.write(piece)
                        self.wfile.flush()
                except OSError:
                    pass  # the browser, or the console, is gone
                finally:
                    upstream.close()
                    self.close_connection = True

            do_GET = do_POST = do_DELETE = forward  # noqa: N815

            def log_message(self, format: str, *args: object) -> None:
                """Nothing: tests say what went wrong."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
