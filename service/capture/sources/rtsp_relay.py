"""A relay on loopback between FFmpeg and a camera whose challenges FFmpeg cannot answer (SHA-256 digest).

It passes everything on as it is, but for addresses (FFmpeg speaks to the relay, the camera shall read its own) and
for answers of 401: those it answers itself, once each. RTP must come on the same connection (`transport: tcp`).
"""

from __future__ import annotations

import contextlib
import re
import selectors
import socket
import ssl
import struct
from dataclasses import dataclass
from threading import Event, Thread
from urllib.parse import unquote, urlsplit

from lumpwatch.service.capture.sources.rtsp_auth import Challenge, best, challenges

_CHUNK = 1 << 16
_MOST_HEAD = 1 << 16
_MOST_WAITING = 8 << 20
_POLL_S = 0.25
_LONGEST_SEND_S = 5.0


@dataclass(frozen=True, slots=True)
class Place:
    """A camera's address, taken apart."""

    scheme: str
    host: str
    port: int
    rest: str
    """Path and query."""
    user: str
    password: str

    @property
    def base(self) -> str:
        """Without path, user and password."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"rtsp://{host}:{self.port}"


def place_of(address: str) -> Place:
    """Of an address whose user and password are percent-encoded. Raises ValueError."""
    parts = urlsplit(address)
    rest = parts.path + (f"?{parts.query}" if parts.query else "")
    secure = parts.scheme == "rtsps"
    user, password = unquote(parts.username or ""), unquote(parts.password or "")
    return Place(
        parts.scheme, parts.hostname or "", parts.port or (322 if secure else 554), rest, user, password
    )


def connect(place: Place, context: ssl.SSLContext | None, timeout_s: float) -> socket.socket:
    """A connection to the camera. Raises OSError, ssl.SSLCertVerificationError among them."""
    raw = socket.create_connection((place.host, place.port), timeout_s)
    if place.scheme != "rtsps":
        return raw
    assert context is not None
    try:
        return context.wrap_socket(raw, server_hostname=place.host)
    except OSError:
        raw.close()
        raise


def offered(place: Place, context: ssl.SSLContext | None, timeout_s: float) -> tuple[Challenge, ...]:
    """The challenges of a camera to whom no password is told. Raises OSError and ValueError."""
    with connect(place, context, timeout_s) as camera:
        request = f"DESCRIBE {place.base}{place.rest} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n"
        camera.sendall(request.encode())
        data = bytearray()
        while b"\r\n\r\n" not in data and len(data) < _MOST_HEAD:
            chunk = camera.recv(_CHUNK)
            if not chunk:
                break
            data += chunk
    return _challenges(bytes(data).partition(b"\r\n\r\n")[0])


class RtspRelay:
    """Serves one connection of FFmpeg, on a thread of its own."""

    def __init__(self, place: Place, context: ssl.SSLContext | None, timeout_s: float) -> None:
        """Listens at once. Raises OSError."""
        self._place, self._context, self._timeout_s = place, context, timeout_s
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(_POLL_S)
        self._here = f"rtsp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._stop = Event()
        self._thread = Thread(target=self._serve, name="rtsp relay", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Where FFmpeg shall connect to."""
        return self._here + self._place.rest

    def close(self) -> None:
        """End it; idempotent."""
        self._stop.set()
        self._listener.close()
        self._thread.join(_LONGEST_SEND_S + self._timeout_s)

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                player, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            self._listener.close()  # for whoever else finds the port
            with contextlib.suppress(OSError, ValueError), player:
                self._converse(player)
            return

    def _converse(self, player: socket.socket) -> None:
        with connect(self._place, self._context, self._timeout_s) as camera:
            _Conversation(player, camera, self._place, self._here.encode()).run(self._stop)


class _Conversation:
    """One connection of FFmpeg to the camera."""

    def __init__(self, player: socket.socket, camera: socket.socket, place: Place, here: bytes) -> None:
        self._player, self._camera, self._place, self._here = player, camera, place, here
        self._there = place.base.encode()
        self._challenge: Challenge | None = None
        self._uses = 0
        self._asked = b""
        self._asked_again = False
        self._from_player, self._from_camera = bytearray(), bytearray()
        for one in (player, camera):
            one.settimeout(_LONGEST_SEND_S)

    def run(self, stop: Event) -> None:
        """Until one side closes. Raises OSError and ValueError."""
        with selectors.DefaultSelector() as ready:
            ready.register(self._player, selectors.EVENT_READ)
            ready.register(self._camera, selectors.EVENT_READ)
            while not stop.is_set():
                for key, _ in ready.select(_POLL_S):
                    if key.fileobj is self._player:
                        self._from_player += _received(self._player)
                        self._requests()
                    else:
                        self._from_camera += _received(self._camera)
                        self._answers()

    def _requests(self) -> None:
        while (message := _next(self._from_player)) is not None:
            if message[:1] == b"$":
                self._camera.sendall(message)
                continue
            self._asked, self._asked_again = message.replace(self._here, self._there), False
            self._ask()

    def _ask(self) -> None:
        head, end, body = self._asked.partition(b"\r\n\r\n")
        if self._challenge is not None:
            method, uri = head.decode("latin-1").split(" ", 2)[:2]
            self._uses += 1
            place = self._place
            answer = self._challenge.answer(place.user, place.password, method, uri, self._uses)
            head += b"\r\nAuthorization: " + answer.encode()
        self._camera.sendall(head + end + body)

    def _answers(self) -> None:
        out = bytearray()
        while (message := _next(self._from_camera)) is not None:
            if message[:1] == b"$":
                out += message
            elif _status(message) == 401 and not self._asked_again and self._known(message):
                self._asked_again = True
                self._ask()
            else:
                out += self._as_here(message)
        if out:
            self._player.sendall(out)

    def _known(self, answer: bytes) -> bool:
        """Whether the challenges of a 401 hold one that can be answered; it is used from now on."""
        self._challenge = best(_challenges(answer.partition(b"\r\n\r\n")[0]))
        self._uses = 0
        return self._challenge is not None

    def _as_here(self, answer: bytes) -> bytes:
        """With the camera's own address, with and without its port, replaced by the relay's."""
        head, end, body = answer.partition(b"\r\n\r\n")
        bare = self._there.rpartition(b":")[0]
        pattern = re.compile(
            re.escape(bare) + b"(?::" + str(self._place.port).encode() + rb")?(?=[/\s;,?]|$)"
        )
        head, body = pattern.sub(self._here, head), pattern.sub(self._here, body)
        if body:
            head = re.sub(rb"(?im)^(content-length:\s*)\d+", rb"\g<1>" + str(len(body)).encode(), head)
        return head + end + body


def _received(side: socket.socket) -> bytes:
    data = side.recv(_CHUNK)
    while data and isinstance(side, ssl.SSLSocket) and side.pending():
        data += side.recv(side.pending())
    if not data:
        raise ConnectionError("closed")
    return data


def _next(waiting: bytearray) -> bytes | None:
    """The next whole message, request, answer or interleaved packet, taken out; None while it is not whole.

    Raises ValueError where it is larger than any that is sent.
    """
    if len(waiting) > _MOST_WAITING:
        raise ValueError("too large a message")
    if not waiting:
        return None
    if waiting[0] == 0x24:
        if len(waiting) < 4:
            return None
        size = 4 + int(struct.unpack_from("!H", waiting, 2)[0])
    else:
        end = waiting.find(b"\r\n\r\n")
        if end < 0:
            if len(waiting) > _MOST_HEAD:
                raise ValueError("too large a header")
            return None
        length = re.search(rb"(?im)^content-length:\s*(\d{1,8})", waiting[:end])
        size = end + 4 + (int(length[1]) if length else 0)
    if len(waiting) < size:
        return None
    message = bytes(waiting[:size])
    del waiting[:size]
    return message


def _status(answer: bytes) -> int | None:
    found = re.match(rb"RTSP/1\.\d (\d{3})", answer)
    return int(found[1]) if found else None


def _challenges(head: bytes) -> tuple[Challenge, ...]:
    lines = re.findall(rb"(?im)^www-authenticate:\s*(.+?)\s*$", head)
    return challenges(line.decode("utf-8", "replace") for line in lines)
