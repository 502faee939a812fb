"""A small RTSP server that plays a video file for ever and can be made to misbehave.

It serves rtsp://HOST:PORT/cam over TCP (interleaved) and UDP without re-encoding (MJPEG is
re-encoded once at start). Lines on stdin control it:

    freeze | thaw     stop sending, go on (time goes on meanwhile)
    drop N            lose the next N pictures
    corrupt N         fill the next N pictures with random bytes
    cut N             send the next N pictures without their last tenth, as a camera that is short of memory does
    hold | release    send every picture with the same RTP time stamp, go on with the right one
    rate R            send R seconds of the video a second, with the time stamps that it has
    back S            let the RTP time stamps jump back by S seconds
    zero              let them begin at 0 again
    kick              close all connections
    refuse | accept   answer DESCRIBE with 503, or normally again

Usage: python -m tests.servers.rtsp_mini VIDEO [--host 127.0.0.1] [--port 0] [--user U --password P]
    [--offers basic,MD5,SHA-256] [--cert PEM --key PEM] [--join-anywhere] [--name NAME] [--encoding utf-8]
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import hashlib
import random
import re
import ssl
import struct
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

from tests.servers.rtp import CLOCK_HZ, AccessUnit, Track, load

_BACKLOG_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class Login:
    """Who is let in, and what is offered for it, in this order."""

    user: str
    password: str
    offers: tuple[str, ...] = ("basic",)
    realm: str = "IP Camera(12345)"
    nonce: str = "5f1c8ad0"

    def challenges(self) -> list[str]:
        """The headers of a 401."""
        said = []
        for one in self.offers:
            if one == "basic":
                said.append(f'WWW-Authenticate: Basic realm="{self.realm}"')
            else:
                qop = ', qop="auth,auth-int"' if one.startswith("SHA") else ""
                said.append(
                    f'WWW-Authenticate: Digest realm="{self.realm}", nonce="{self.nonce}", algorithm={one}{qop}'
                )
        return said

    def admits(self, method: str, given: str) -> bool:
        """Whether the header `Authorization` is right."""
        if given.startswith("Basic "):
            right = base64.b64encode(f"{self.user}:{self.password}".encode()).decode()
            return "basic" in self.offers and given == f"Basic {right}"
        said = dict(re.findall(r'(\w+)="?([^",]*)"?', given.removeprefix("Digest ")))
        algorithm = said.get("algorithm", "MD5")
        if algorithm not in self.offers:
            return False

        def hashed(text: str) -> str:
            return hashlib.new(algorithm.replace("-", "").lower(), text.encode()).hexdigest()

        turn = [said[name] for name in ("nc", "cnonce", "qop")] if "qop" in said else []
        parts = [hashed(f"{self.user}:{self.realm}:{self.password}"), self.nonce, *turn]
        right = hashed(":".join([*parts, hashed(f"{method}:{said.get('uri')}")]))
        return said.get("username") == self.user and said.get("response") == right


@dataclass(slots=True)
class Mischief:
    """What the server does wrong at present."""

    frozen: bool = False
    drop: int = 0
    corrupt: int = 0
    cut: int = 0
    held_ticks: int | None = None
    shift_ticks: int = 0
    zero: bool = False
    refuse: bool = False
    rate: float = 1.0


class Client:
    """One RTSP connection."""

    def __init__(self, server: Server, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._server = server
        self._reader = reader
        self._writer = writer
        self._session = f"{random.getrandbits(32):08x}"
        self._ssrc = random.getrandbits(32)
        self._seq = random.getrandbits(15)
        self._channel = 0
        self._udp: asyncio.DatagramTransport | None = None
        self._playing = False
        self._needs_key = not server.join_anywhere

    async def serve(self) -> None:
        """Answer requests until the client goes."""
        try:
            while await self._answer():
                pass
        except (asyncio.IncompleteReadError, ConnectionError, ssl.SSLError):
            pass
        finally:
            self.close()

    def close(self) -> None:
        """End the connection; idempotent."""
        self._server.clients.discard(self)
        self._playing = False
        self._writer.close()
        if self._udp:
            self._udp.close()

    async def _answer(self) -> bool:
        start = await self._reader.readexactly(1)
        if start == b"$":  # interleaved RTCP of the client
            (size,) = struct.unpack("!xH", await self._reader.readexactly(3))
            await self._reader.readexactly(size)
            return True
        head = (start + await self._reader.readuntil(b"\r\n\r\n")).decode()
        request, *lines = head.split("\r\n")
        method, url, _ = request.split(" ", 2)
        headers = {k.strip().lower(): v.strip() for k, _, v in (line.partition(":") for line in lines)}
        await self._reader.readexactly(int(headers.get("content-length", 0)))
        status, extra, text = await self._respond(method, url, headers)
        body = text.encode(self._server.encoding)
        lines = [
            f"RTSP/1.0 {status}",
            f"CSeq: {headers.get('cseq', '0')}",
            f"Session: {self._session};timeout=60",
        ]
        lines += [*extra, f"Content-Length: {len(body)}", "", ""]
        self._writer.write("\r\n".join(lines).encode() + body)
        await self._writer.drain()
        return method != "TEARDOWN"

    async def _respond(self, method: str, url: str, headers: dict[str, str]) -> tuple[str, list[str], str]:
        server = self._server
        if method == "OPTIONS":
            return "200 OK", ["Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN, GET_PARAMETER"], ""
        if server.login and not server.login.admits(method, headers.get("authorization", "")):
            return "401 Unauthorized", server.login.challenges(), ""
        if method == "DESCRIBE":
            if server.mischief.refuse:
                return "503 Service Unavailable", [], ""
            if not url.rstrip("/").endswith("/cam"):
                return "404 Not Found", [], ""
            return (
                "200 OK",
                ["Content-Type: application/sdp", f"Content-Base: {url.rstrip('/')}/"],
                server.sdp(),
            )
        if method == "SETUP":
            return await self._setup(headers["transport"])
        if method == "PLAY":
            self._playing = True
            return "200 OK", ["Range: npt=0.000-"], ""
        if method in ("TEARDOWN", "GET_PARAMETER"):
            return "200 OK", [], ""
        return "405 Method Not Allowed", [], ""

    async def _setup(self, transport: str) -> tuple[str, list[str], str]:
        options = dict(part.partition("=")[::2] for part in transport.split(";"))
        if "interleaved" in options:
            self._channel = int(options["interleaved"].split("-")[0])
            return "200 OK", [f"Transport: RTP/AVP/TCP;unicast;interleaved={options['interleaved']}"], ""
        if "client_port" not in options:
            return "461 Unsupported Transport", [], ""
        port = int(options["client_port"].split("-")[0])
        here, there = (self._writer.get_extra_info(name)[0] for name in ("sockname", "peername"))
        self._udp, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            asyncio.DatagramProtocol, local_addr=(here, 0), remote_addr=(there, port)
        )
        mine = self._udp.get_extra_info("sockname")[1]
        return (
            "200 OK",
            [f"Transport: RTP/AVP;unicast;client_port={port}-{port + 1};server_port={mine}-{mine + 1}"],
            "",
        )

    def send(self, unit: AccessUnit, ticks: int, damage: bool) -> None:
        """Send one picture if the client plays; a slow client loses pictures up to the next key."""
        if not self._playing or (self._needs_key and not unit.key):
            return
        self._needs_key = False
        track = self._server.track
        payloads = list(track.payloads(unit))
        packets = []
        for i, payload in enumerate(payloads):
            if damage:
                spared = payload[: track.header_bytes]
                payload = spared + random.randbytes(len(payload) - len(spared))
            marker = 0x80 if i == len(payloads) - 1 else 0
            fields = (0x80, track.payload_type | marker, self._seq & 0xFFFF, ticks & 0xFFFFFFFF, self._ssrc)
            packets.append(struct.pack("!BBHII", *fields) + payload)
            self._seq += 1
        if self._udp:
            for packet in packets:
                self._udp.sendto(packet)
        elif self._writer.transport.get_write_buffer_size() < _BACKLOG_BYTES:
            self._writer.write(
                b"".join(struct.pack("!cBH", b"$", self._channel, len(p)) + p for p in packets)
            )
        else:
            self._needs_key = True


class Server:
    """Plays one track to all clients in real time."""

    def __init__(
        self,
        track: Track,
        login: Login | None,
        *,
        join_anywhere: bool = False,
        name: str = "cam",
        encoding: str = "utf-8",
    ) -> None:
        """`name` is that of the session; its description is sent in `encoding`."""
        self.name, self.encoding = name, encoding
        self.track = track
        self.login = login
        self.join_anywhere = join_anywhere
        self.mischief = Mischief()
        self.clients: set[Client] = set()

    def sdp(self) -> str:
        """The session description."""
        head = ["v=0", "o=- 1 1 IN IP4 127.0.0.1", f"s={self.name}", "c=IN IP4 0.0.0.0", "t=0 0"]
        media = [f"m=video 0 RTP/AVP {self.track.payload_type}", *self.track.sdp, "a=control:track0"]
        return "\r\n".join([*head, *media, ""])

    async def connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        client = Client(self, reader, writer)
        self.clients.add(client)
        await client.serve()

    async def play(self) -> None:
        """Send the track again and again; after a pause of the process it catches up in a burst."""
        due_s, last, lap = time.monotonic(), 0, 0
        while True:
            for unit in self.track.units:
                ticks = lap * self.track.lap_ticks + unit.ticks
                due_s, last = due_s + (ticks - last) / CLOCK_HZ / self.mischief.rate, ticks
                await asyncio.sleep(max(due_s - time.monotonic(), 0))
                self._send(unit, ticks)
            lap += 1

    def _send(self, unit: AccessUnit, ticks: int) -> None:
        mischief = self.mischief
        if mischief.frozen:
            return
        if mischief.drop:
            mischief.drop -= 1
            return
        if mischief.zero:
            mischief.zero, mischief.shift_ticks = False, ticks
        if mischief.cut:
            mischief.cut -= 1
            unit = replace(unit, parts=tuple(part[: len(part) * 9 // 10] for part in unit.parts))
        damage = mischief.corrupt > 0
        mischief.corrupt -= damage
        ticks -= mischief.shift_ticks
        if mischief.held_ticks is not None:
            mischief.held_ticks = ticks = mischief.held_ticks or ticks
        for client in list(self.clients):
            client.send(unit, ticks, damage)

    def obey(self, line: str) -> None:
        """Carry out one line of the control language."""
        mischief = self.mischief
        match line.split():
            case ["freeze" | "thaw" as word]:
                mischief.frozen = word == "freeze"
            case ["refuse" | "accept" as word]:
                mischief.refuse = word == "refuse"
            case ["hold" | "release" as word]:
                mischief.held_ticks = 0 if word == "hold" else None
            case ["drop", count]:
                mischief.drop = int(count)
            case ["corrupt", count]:
                mischief.corrupt = int(count)
            case ["cut", count]:
                mischief.cut = int(count)
            case ["back", seconds]:
                mischief.shift_ticks += round(float(seconds) * CLOCK_HZ)
            case ["rate", share]:
                mischief.rate = float(share)
            case ["zero"]:
                mischief.zero = True
            case ["kick"]:
                for client in list(self.clients):
                    client.close()
            case _:
                print(f"unknown command: {line.strip()}", file=sys.stderr)


async def run(server: Server, host: str, port: int, tls: ssl.SSLContext | None) -> None:
    """Listen, print the URL, then play until stdin closes."""
    loop = asyncio.get_running_loop()
    listener = await asyncio.start_server(server.connect, host, port, ssl=tls)
    print(f"{'rtsps' if tls else 'rtsp'}://{host}:{listener.sockets[0].getsockname()[1]}/cam", flush=True)
    commands = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(commands), sys.stdin)

    async def listen() -> None:
        while line := await commands.readline():
            server.obey(line.decode())

    tasks = [asyncio.create_task(server.play()), asyncio.create_task(listen())]
    done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in done:
        task.result()  # a player that died must not go unnoticed


def main() -> None:
    """Parse the arguments and run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("video", type=Path)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--user")
    parser.add_argument("--password", default="")
    parser.add_argument("--offers", default="basic")
    parser.add_argument("--cert")
    parser.add_argument("--key")
    parser.add_argument("--join-anywhere", action="store_true")
    parser.add_argument("--name", default="cam")
    parser.add_argument("--encoding", default="utf-8")
    args = parser.parse_args()
    login, tls = None, None
    if args.user is not None:
        login = Login(args.user, args.password, tuple(args.offers.split(",")))
    if args.cert:
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(args.cert, args.key)
    server = Server(
        load(args.video), login, join_anywhere=args.join_anywhere, name=args.name, encoding=args.encoding
    )
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(run(server, args.host, args.port, tls))


if __name__ == "__main__":
    main()
