"""The attacks. Each does one and tells what became of it: taken, or refused with an error of ours.

Any other exception is a finding and goes up.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import socket
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from prometheus_client import CollectorRegistry

from lumpwatch.service.bus.codec import decode_header, decode_pixels, encode_frame, encode_jpeg
from lumpwatch.service.config import parse_config
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.core.plain_text import printable
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import COMMANDS
from lumpwatch.service.protocol.requests import read_request
from lumpwatch.service.storage.checksummed import seal
from lumpwatch.service.storage.event_log import event_file
from lumpwatch.service.storage.prior_file import decode_prior, encode_prior
from lumpwatch.service.telemetry import TelemetryServer
from tests.attacks.mutations import Random, mutated
from tests.bus.test_bus_support import eventually
from tests.gateway.test_modbus import Served, read, serving
from tests.service_helpers import site_tree
from tests.storage.test_absurd_contents import GOOD
from tests.storage.test_event_log import entry, sequences, writer

Attack = Callable[[Random], str]
"""Does one; `taken` or `refused`."""
TAKEN, REFUSED = "taken", "refused"


def _judge(deed: Callable[[], object]) -> str:
    try:
        deed()
    except LumpwatchError as error:
        line = str(error)
        assert printable(line) == line, f"not one plain line: {line!r}"
        return REFUSED
    return TAKEN


@contextlib.contextmanager
def frames(_: Path) -> Iterator[Attack]:
    """Frames on the bus: header and pixels, raw and JPEG."""
    picture = np.random.default_rng(1).integers(0, 255, (24, 32), np.uint8)
    frame = Frame(7, 1.5, 1.25, 1e9, 32, 24, "gray8", picture)
    whole = (encode_frame(frame, "clock"), encode_jpeg(frame, 80, "clock"))

    def attack(rng: Random) -> str:
        payload, header = whole[int(rng.integers(0, 2))]
        if rng.random() < 0.7:
            header = mutated(header, rng)
        if rng.random() < 0.5:
            payload = mutated(payload, rng)
        return _judge(lambda: decode_pixels(payload, decode_header(header)))

    yield attack


@contextlib.contextmanager
def commands(_: Path) -> Iterator[Attack]:
    """Commands on the bus: each row of the table, by parameters and by payload."""
    rows = tuple(COMMANDS.values())

    def attack(rng: Random) -> str:
        row = rows[int(rng.integers(0, len(rows)))]
        text = json.dumps(row.example.model_dump(mode="json", by_alias=True)).encode()
        payload = mutated(text, rng) if rng.random() < 0.8 else None
        given = {}
        for name, value in json.loads(text).items():
            if rng.random() < 0.5:
                given[name] = mutated(str(value).encode(), rng).decode(errors="replace")

        def deed() -> None:
            request = read_request(row.request, given, payload)
            if row.action is not None:
                row.action(request)

        return _judge(deed)

    yield attack


@contextlib.contextmanager
def configurations(_: Path) -> Iterator[Attack]:
    """Configuration files."""
    text = json.dumps(site_tree(), indent=1).encode()

    def attack(rng: Random) -> str:
        made = mutated(text, rng).decode(errors="replace")
        return _judge(lambda: parse_config(made, environ={}))

    yield attack


@contextlib.contextmanager
def priors(_: Path) -> Iterator[Attack]:
    """Prior files whose checksum is right whatever they hold."""
    content = encode_prior(GOOD)
    body = content[content.index(b"\n") + 1 :]

    def attack(rng: Random) -> str:
        made = mutated(body, rng)
        return _judge(lambda: decode_prior(seal("prior", 1, made), "x"))

    yield attack


@contextlib.contextmanager
def event_logs(folder: Path) -> Iterator[Attack]:
    """Event logs that a disk has damaged: the next event is written and read again."""
    log = writer(folder)
    assert log.write([entry(number) for number in range(1, 20)])
    log.close()
    path = event_file(folder, "cam")
    content = path.read_bytes()

    def attack(rng: Random) -> str:
        for file in path.parent.iterdir():
            file.unlink()
        path.write_bytes(mutated(content, rng))
        again = writer(folder, retry_s=0.05)
        number = iter(range(20, 20_000))

        def written() -> bool:
            return again.write([entry(next(number))])

        eventually(written)  # a row that is no text any more costs one attempt
        again.close()
        found = sequences(folder)
        assert found[-1] >= 20
        return TAKEN if len(found) > 1 else REFUSED

    yield attack


@contextlib.contextmanager
def modbus(_: Path) -> Iterator[Attack]:
    """Requests to the gateway: another master is served all the while."""
    request = bytes.fromhex("000100000006010400000054")

    with serving() as served, served.connect() as master:
        yield lambda rng: _rubbish(served, master, mutated(request, rng))


def _rubbish(served: Served, master: socket.socket, sent: bytes) -> str:
    with served.connect() as stranger:
        stranger.settimeout(0.02)
        with contextlib.suppress(OSError):
            stranger.sendall(sent)
            stranger.shutdown(socket.SHUT_WR)
        answer = b""
        with contextlib.suppress(OSError):
            answer = stranger.recv(300)
    served.set(1)  # what is a second old is not served
    assert len(read(master, 0, 2)) == 2
    return TAKEN if answer[7:8] == b"\x04" else REFUSED


_REQUESTS = (
    b"GET /metrics HTTP/1.1\r\nHost: x\r\nAccept: application/openmetrics-text;version=1.0.0;q=0.5,*/*;q=0.1\r\n\r\n",
    b"GET /metrics?name[]=up&name%5B%5D=x HTTP/1.1\r\nAccept: application/openmetrics-text;version=abc\r\n\r\n",
    b"GET /readyz HTTP/1.0\r\n\r\n",
    b"POST /livez HTTP/1.1\r\nContent-Length: 5\r\n\r\nhello",
)


@contextlib.contextmanager
def page(_: Path) -> Iterator[Attack]:
    """Requests to the page of metrics and health; the first of each kind is as it should be."""
    health = SimpleNamespace(live=list, ready=list, started=list)
    failures: list[type[BaseException]] = []

    class Failures(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.exc_info is not None and (kind := record.exc_info[0]) is not None:
                failures.append(kind)

    told = logging.getLogger("lumpwatch.service.telemetry.http")
    handler, level = Failures(), told.level
    told.addHandler(handler)
    told.setLevel(logging.DEBUG)
    turn = itertools.count()

    def attack(rng: Random) -> str:
        number = next(turn)
        whole = _REQUESTS[number % len(_REQUESTS)]
        sent = whole if number < len(_REQUESTS) else mutated(whole, rng)
        answer = b""
        with socket.create_connection(address, timeout=5.0) as client, contextlib.suppress(OSError):
            client.sendall(sent)
            client.shutdown(socket.SHUT_WR)
            answer = client.recv(300)
        assert not [kind for kind in failures if not issubclass(kind, OSError)]
        return TAKEN if b" 200 " in answer[:20] else REFUSED

    try:
        with TelemetryServer(("127.0.0.1", 0), CollectorRegistry(), health) as server:
            address = ("127.0.0.1", int(server.url.rpartition(":")[2]))
            yield attack
    finally:
        told.removeHandler(handler)
        told.setLevel(level)


KINDS: Mapping[str, Callable[[Path], contextlib.AbstractContextManager[Attack]]] = {
    "frames on the bus": frames,
    "commands on the bus": commands,
    "configurations": configurations,
    "priors with a right checksum": priors,
    "damaged event logs": event_logs,
    "Modbus requests": modbus,
    "requests to the page": page,
}
