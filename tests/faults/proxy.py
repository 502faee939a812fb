"""A slow network: a TCP proxy on loopback that holds back what the server sends."""

from __future__ import annotations

import contextlib
import queue
import socket
import threading
import time
from typing import Self


class SlowProxy:
    """Passes connections on to a port of this host; `delay_s` may be changed at any time."""

    def __init__(self, port: int) -> None:
        self.delay_s = 0.0
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        for one in self._open:
            _end(one)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(("127.0.0.1", self._target))
                self._open += [client, server]
                waiting: queue.Queue[tuple[float, bytes]] = queue.Queue()
                for job, arguments in (
                    (_forward, (client, server)),
                    (self._take, (server, waiting)),
                    (_give, (waiting, client)),
                ):
                    threading.Thread(target=job, args=arguments, daemon=True).start()

    def _take(self, server: socket.socket, waiting: queue.Queue[tuple[float, bytes]]) -> None:
        with contextlib.suppress(OSError):
            while chunk := server.recv(65536):
                waiting.put((time.monotonic() + self.delay_s, chunk))
        waiting.put((time.monotonic() + self.delay_s, b""))


def _forward(client: socket.socket, server: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while chunk := client.recv(65536):
            server.sendall(chunk)
    _end(server)


def _give(waiting: queue.Queue[tuple[float, bytes]], client: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while (one := waiting.get())[1]:
            time.sleep(max(0.0, one[0] - time.monotonic()))
            client.sendall(one[1])
    _end(client)


def _end(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()
