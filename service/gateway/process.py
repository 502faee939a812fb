"""The gateway's process: a client of the bus, one event loop, and what it serves in it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from typing import Protocol

from lumpwatch.service.bus import Bus, BusClosed, Keys, open_client
from lumpwatch.service.config import BusConfig, SiteConfig
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.gateway.chain import Chain
from lumpwatch.service.gateway.errors import GatewayError
from lumpwatch.service.gateway.orders import Ask, Orders, by_bus
from lumpwatch.service.gateway.register_map import RegisterMap
from lumpwatch.service.gateway.values import SiteValues

log = logging.getLogger(__name__)

EVERY_S = 0.05
"""How often values are made anew without news."""
_LEAST_S = 0.005
"""News that come faster than this are taken together."""


Served = dict[str, str]
"""Where each protocol that is served can be reached."""


class Server(Protocol):
    """One protocol of the plant's."""

    @property
    def address(self) -> str:
        """Where it can be reached, once it has started."""

    def set(self, values: SiteValues) -> None:
        """Say these from now on; must not wait."""

    def alarm(self, camera: str, roi: str, payload: bytes) -> None:
        """An alarm record, each once and in order, in a thread of the bus; must not wait."""

    async def start(self) -> None:
        """Begin to serve. Raises GatewayError."""

    async def close(self) -> None:
        """End."""


def run_gateway(
    config: SiteConfig, stop: threading.Event, on_ready: Callable[[Served], None] = lambda _: None
) -> None:
    """Serve until `stop` is set; `on_ready` gets the addresses.

    Raises ConfigError where nothing is to be served, and GatewayError where it cannot be.

    What it serves is there at once, whether the bus is or not: its quality is Bad until the regions are heard.
    """
    asked = config.gateway
    if asked.modbus is None and asked.opcua is None and asked.mqtt is None:
        raise ConfigError("gateway: nothing to serve: expected gateway.modbus, gateway.opcua or gateway.mqtt")
    asyncio.run(_run(config, stop, on_ready))


async def _run(config: SiteConfig, stop: threading.Event, on_ready: Callable[[Served], None]) -> None:
    loop = asyncio.get_running_loop()
    news = asyncio.Event()

    def on_news() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(news.set)

    register_map = RegisterMap(config)
    chain = Chain(config, register_map.regions, on_news=on_news)
    late = _Bus(config, stop)
    orders = Orders(late.ask, config.gateway.plant, config.gateway.actor)
    served = _servers(config, register_map, orders, late.ask)
    async with contextlib.AsyncExitStack() as stack:
        for name, server in served.items():
            server.set(chain.values())
            await server.start()
            stack.push_async_callback(server.close)
            log.info("%s on %s", name, server.address)
        stack.callback(late.close)
        late.start(chain, tuple(served.values()))
        threading.Thread(target=orders.run, args=(stop,), name="orders", daemon=True).start()
        on_ready({name: server.address for name, server in served.items()})
        while not stop.is_set():
            news.clear()
            values = chain.values()
            for server in served.values():
                server.set(values)
            await asyncio.sleep(_LEAST_S)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(news.wait(), EVERY_S)


def _servers(config: SiteConfig, register_map: RegisterMap, orders: Orders, ask: Ask) -> dict[str, Server]:
    """What the configuration asks for; a protocol's library is loaded only there. Raises GatewayError without it."""
    served: dict[str, Server] = {}
    try:
        if config.gateway.modbus is not None:
            from lumpwatch.service.gateway.modbus import ModbusServer

            served["modbus"] = ModbusServer(config.gateway.modbus, register_map, orders)
        if (opcua := config.gateway.opcua) is not None:
            from lumpwatch.service.gateway.opcua import OpcUaServer

            actor = config.gateway.actor
            served["opcua"] = OpcUaServer(opcua, config.site, register_map, actor, ask)
        if (mqtt := config.gateway.mqtt) is not None:
            from lumpwatch.service.gateway.mqtt import MqttServer
            from lumpwatch.service.gateway.sparkplug_node import SparkplugNode

            served["mqtt"] = MqttServer(mqtt, config.site, orders)
            if mqtt.sparkplug is not None:
                served["sparkplug"] = SparkplugNode(mqtt, mqtt.sparkplug, config.site, register_map, orders)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("lumpwatch"):
            raise
        extra = "opcua" if error.name.partition(".")[0] == "asyncua" else "gateway"
        raise GatewayError(
            f"the package {error.name} is missing, which the gateway needs: pip install 'lumpwatch[{extra}]'"
        ) from error
    return served


class _Bus:
    """The bus, joined in a thread of its own: what is served does not wait for it."""

    def __init__(self, config: SiteConfig, stop: threading.Event) -> None:
        self._config = config
        self._stop = stop
        self._bus: Bus | None = None
        self._thread: threading.Thread | None = None

    def start(self, chain: Chain, servers: tuple[Server, ...]) -> None:
        """Join, have `chain` follow, and pass alarm records to the servers."""
        self._thread = threading.Thread(target=self._join, args=(chain, servers), name="join", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=6.0)
        if self._bus is not None:
            self._bus.close()

    def ask(self, region: tuple[str, str], command: str, parameters: dict[str, object]) -> str | None:
        """Give a command."""
        if self._bus is None:
            return "the bus is not there"
        return by_bus(self._bus, self._config.site)(region, command, parameters)

    def _join(self, chain: Chain, servers: tuple[Server, ...]) -> None:
        try:
            bus = open_client(_as_client(self._config), self._stop)
        except BusClosed:
            return
        chain.follow(bus)

        def on_alarm(key: str, payload: bytes) -> None:
            camera, roi = key.split("/")[-3:-1]
            for server in servers:
                server.alarm(camera, roi, payload)

        bus.subscribe_alarms(Keys(self._config.site).alarms(), on_alarm)
        bus.alive(Keys(self._config.site).alive("gateway", self._config.site))
        self._bus = bus


def _as_client(config: SiteConfig) -> BusConfig:
    """How the gateway joins: as a client, with its own certificate where it has one."""
    bus = config.bus
    tls = config.gateway.bus_tls or bus.tls
    return bus.model_copy(update={"mode": "client", "connect": bus.joined, "listen": (), "tls": tls})
