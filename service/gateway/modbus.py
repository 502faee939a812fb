"""Modbus TCP: requests are read one at a time and within bounds; pymodbus takes them apart and answers.

All registers of an answer come from one set of values. When the set is older than `STALE_S`, because this process
does not come to make new ones, every read is answered by the exception "server device failure": a master sees that,
and no old value, whatever it does with the heartbeat.

The connection is read here and not by pymodbus' own server: a request is answered before the next one is read, so
nobody fills a queue, and a connection has bounds in time, rate and number.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import time
from collections.abc import Callable
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU

from lumpwatch.service.config import ModbusConfig
from lumpwatch.service.gateway.errors import GatewayError
from lumpwatch.service.gateway.orders import Orders
from lumpwatch.service.gateway.register_map import RegisterMap
from lumpwatch.service.gateway.values import SiteValues

log = logging.getLogger(__name__)
# Rubbish is a client's affair and is counted: pymodbus would log a line for every byte string of it.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

STALE_S = 1.0
"""Values that are older are no longer served."""
_HEADER, _LONGEST = 7, 254
_PARTIAL_S = 5.0
"""The rest of a request must come within this."""
_WRITE_S = 5.0
"""An answer must be taken within this."""
_READ_COILS, _WRITE_COIL, _WRITE_COILS = 1, 5, 15
_READS = (_READ_COILS, 3, 4)
_SERVED = (*_READS, _WRITE_COIL, _WRITE_COILS)


class ModbusServer:
    """Serves one register map; `set` gives it new values. Everything runs in one event loop."""

    def __init__(
        self,
        config: ModbusConfig,
        register_map: RegisterMap,
        orders: Orders,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._config = config
        self._map = register_map
        self._orders = orders
        self._clock = clock
        self._words: tuple[int, ...] = ()
        self._set_s = float("-inf")
        self._framer = FramerSocket(DecodePDU(True))
        self._connections: dict[_Connection, None] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None
        self.address = ""
        """Where it listens, once it does."""
        self.rubbish = 0
        """Requests that were none, and connections that were ended for it."""

    def set(self, values: SiteValues) -> None:
        """Serve these from now on."""
        self._words, self._set_s = self._map.words(values), self._clock()

    def alarm(self, camera: str, roi: str, payload: bytes) -> None:
        """Alarms are values here."""

    async def start(self) -> None:
        """Listen. Raises GatewayError."""
        host, port = self._config.address
        try:
            self._server = await asyncio.start_server(self._accept, host, port, limit=512, backlog=64)
        except OSError as error:
            raise GatewayError(
                f"gateway.modbus: cannot listen on {self._config.listen} ({error.strerror or error})"
            ) from error
        bound_host, bound_port = self._server.sockets[0].getsockname()[:2]
        self.address = f"[{bound_host}]:{bound_port}" if ":" in bound_host else f"{bound_host}:{bound_port}"

    async def close(self) -> None:
        """End all connections."""
        if self._server is not None:
            self._server.close()
        for task in (tasks := list(self._tasks)):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    @property
    def connections(self) -> int:
        """How many there are now."""
        return len(self._connections)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.get_running_loop().create_task(self._serve(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = str((writer.get_extra_info("peername") or ("",))[0]).partition("%")[0]
        connection = _Connection(reader, writer, self._clock)
        if not self._allowed(peer):
            log.warning("modbus: %s is not among gateway.modbus.clients", peer)
            connection.end()
            return
        self._make_room()
        self._connections[connection] = None
        may_write = self._may_write(peer)
        try:
            while (frame := await connection.request(self._config.idle_s)) is not None:
                answer = await self.answer(frame, may_write=may_write)
                if answer is None:
                    self.rubbish += 1
                    break
                connection.asked_s = self._clock()
                await connection.reply(answer)
                await connection.slow_down(self._config.most_requests_per_s)
        except (ConnectionError, TimeoutError, OSError):
            pass
        finally:
            self._connections.pop(connection, None)
            connection.end()

    def _make_room(self) -> None:
        """One that asked nothing yet goes first, then the one that asked longest ago."""
        while len(self._connections) >= self._config.most_connections:
            oldest = min(self._connections, key=lambda one: (one.asked_s, one.since_s))
            self._connections.pop(oldest)
            oldest.end()

    def _allowed(self, peer: str) -> bool:
        return _is_in(peer, self._config.clients) if self._config.clients else _is_loopback(peer)

    def _may_write(self, peer: str) -> bool:
        return self._config.writers is None or _is_in(peer, self._config.writers)

    async def answer(self, frame: bytes, *, may_write: bool) -> bytes | None:
        """The answer to one request, MBAP header included; None where it is none of Modbus."""
        transaction, protocol, unit = frame[0:2], frame[2:4], frame[6]
        if protocol != b"\x00\x00" or len(frame) < _HEADER + 1:
            return None
        code = frame[_HEADER]
        if code not in _SERVED or (code not in _READS and not may_write):
            answered: ModbusPDU = ExceptionResponse(code & 0x7F, ExcCodes.ILLEGAL_FUNCTION)
        elif code in _READS and self._clock() - self._set_s > STALE_S:
            answered = ExceptionResponse(code, ExcCodes.DEVICE_FAILURE)
        else:
            answered = await self._execute(frame[_HEADER:], code, unit)
        answered.transaction_id, answered.dev_id = int.from_bytes(transaction, "big"), unit
        return bytes(self._framer.buildFrame(answered))

    async def _execute(self, pdu: bytes, code: int, unit: int) -> ModbusPDU:
        try:
            request = self._framer.decoder.decode(pdu)
            if request is None or not _is_well_formed(request.encode(), pdu[1:], code):
                return ExceptionResponse(code, ExcCodes.ILLEGAL_VALUE)
            context: Any = self  # what pymodbus asks of a data store are the two methods below
            answered: ModbusPDU = await request.datastore_update(context, unit)
        except Exception:  # a request that its own decoder stumbles over
            return ExceptionResponse(code, ExcCodes.ILLEGAL_VALUE)
        return answered

    async def async_getValues(  # noqa: N802 - the name is pymodbus'
        self, device_id: int, func_code: int, address: int, count: int = 1
    ) -> list[int] | list[bool] | ExcCodes:
        """Registers, or coils, of one moment."""
        if func_code in (_READ_COILS, _WRITE_COIL, _WRITE_COILS):
            if address + count > self._map.coils:
                return ExcCodes.ILLEGAL_ADDRESS
            return [self._coil(address + i) for i in range(count)]
        if address + count > len(self._words):
            return ExcCodes.ILLEGAL_ADDRESS
        return list(self._words[address : address + count])

    async def async_setValues(  # noqa: N802
        self, device_id: int, func_code: int, address: int, values: list[bool]
    ) -> ExcCodes | None:
        """All coils that are written exist, or none is written."""
        found = [self._map.coil(address + i) for i in range(len(values))]
        if not all(found):
            return ExcCodes.ILLEGAL_ADDRESS
        for place, value in zip(found, values, strict=True):
            if place is not None:
                self._orders.write(*place, bool(value))
        return None

    def _coil(self, address: int) -> bool:
        place = self._map.coil(address)
        return place is not None and self._orders.read(*place)


class _Connection:
    """A client: its requests, one after another."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, clock: Callable[[], float]
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._clock = clock
        self.since_s = clock()
        self.asked_s = float("-inf")
        """When the last request of it was answered."""
        self._second_s = self.since_s
        self._in_second = 0
        # No more than this waits for a client that does not read.
        writer.transport.set_write_buffer_limits(high=4096)

    async def request(self, idle_s: float) -> bytes | None:
        """The next request with its header; None at the end, or where it is too long. Raises TimeoutError."""
        try:
            first = await asyncio.wait_for(self._reader.readexactly(1), idle_s)
            async with asyncio.timeout(_PARTIAL_S):
                header = first + await self._reader.readexactly(_HEADER - 1)
                length = int.from_bytes(header[4:6], "big")
                if not 2 <= length <= _LONGEST:
                    return None
                return header + await self._reader.readexactly(length - 1)
        except asyncio.IncompleteReadError:
            return None

    async def reply(self, answer: bytes) -> None:
        """Send; raises TimeoutError where the client does not read."""
        self._writer.write(answer)
        async with asyncio.timeout(_WRITE_S):
            await self._writer.drain()

    async def slow_down(self, most_per_s: int) -> None:
        """Wait where it asked more than that in a second."""
        now = self._clock()
        if now - self._second_s >= 1.0:
            self._second_s, self._in_second = now, 0
        self._in_second += 1
        if self._in_second > most_per_s:
            await asyncio.sleep(max(0.0, self._second_s + 1.0 - now))
        else:
            await asyncio.sleep(0)  # what is in the buffer already must not keep others waiting

    def end(self) -> None:
        """Cut it off, whatever waits to be sent."""
        with contextlib.suppress(Exception):
            self._writer.transport.abort()


def _is_well_formed(again: bytes, given: bytes, code: int) -> bool:
    """Whether a request was understood whole: encoded again it is what was given. Unused bits of coils may be any."""
    return len(again) == len(given) if code == _WRITE_COILS else again == given


def _is_in(peer: str, networks: tuple[Any, ...]) -> bool:
    try:
        address = ipaddress.ip_address(peer)
    except ValueError:
        return False
    address = getattr(address, "ipv4_mapped", None) or address
    return any(address in network for network in networks)


def _is_loopback(peer: str) -> bool:
    return _is_in(peer, (ipaddress.ip_network("127.0.0.0/8"), ipaddress.ip_network("::1/128")))
