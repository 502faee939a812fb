"""The gateway to the plant's control system: what it serves there, and to whom."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, IPvAnyNetwork, model_validator

from lumpwatch.service.config.address import HostPort, host_and_port, is_loopback
from lumpwatch.service.config.base import PositiveSeconds, Strict
from lumpwatch.service.config.bus import TlsConfig
from lumpwatch.service.core import AlarmClass

RegionName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}/[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")
]


class ModbusConfig(Strict):
    """Modbus TCP. The protocol knows neither passwords nor encryption: addresses are all that it can go by."""

    listen: HostPort = "127.0.0.1:5020"
    """`host:port` of the server; port 0 takes a free one. The registered port 502 needs a privilege."""
    clients: tuple[IPvAnyNetwork, ...] = ()
    """Addresses or networks that may connect; left out: this host alone."""
    writers: tuple[IPvAnyNetwork, ...] | None = None
    """Of those, who may write coils; left out: all of them. An empty list: nobody."""
    most_connections: Annotated[int, Field(ge=2, le=1000)] = 32
    """Connections at a time. One more ends the connection that has asked nothing for longest."""
    idle_s: PositiveSeconds = 60.0
    """A connection that asks nothing for so long is ended."""
    most_requests_per_s: Annotated[int, Field(ge=10, le=10_000)] = 200
    """Requests that one connection is answered in a second; what comes faster waits, and others do not."""

    @model_validator(mode="after")
    def _closed(self) -> Self:
        if not is_loopback(self.address[0]) and not self.clients:
            raise ValueError("an address that others reach needs clients: Modbus knows no password")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.listen)


class PlantConfig(Strict):
    """What the plant's signals do to alarms while they last, and how long one counts."""

    valid_s: PositiveSeconds = 10.0
    """A signal that the plant does not write again within so long is unknown, and suppresses nothing any more."""
    feeder_stopped: tuple[AlarmClass, ...] = (AlarmClass.LUMP,)
    """Alarms that are suppressed while the plant says that the feeder does not run."""
    maintenance: tuple[AlarmClass, ...] = tuple(AlarmClass)
    """Alarms that are suppressed while the plant says that the machine is in maintenance."""


class GatewayConfig(Strict):
    """The gateway to the plant's control system (`lumpwatch gateway`), a process of its own."""

    modbus: ModbusConfig | None = None
    """Serve Modbus TCP."""
    plant: PlantConfig = PlantConfig()
    """What the plant's signals do."""
    order: tuple[RegionName, ...] = ()
    """Regions as `CAMERA/ROI` in the order of the map, the others behind them as the configuration has them. A region
    that is named keeps its addresses when cameras are added or removed before it."""
    actor: Annotated[str, Field(min_length=1, max_length=64)] = "plc"
    """Who acknowledges, in the records of alarms, where the plant's control system does."""
    bus_tls: TlsConfig | None = None
    """The gateway's own certificate on the bus, to be named in `bus.access.gateways`; left out: `bus.tls`."""

    @model_validator(mode="after")
    def _once(self) -> Self:
        if twice := {name for name in self.order if self.order.count(name) > 1}:
            raise ValueError(f"order: '{min(twice)}' is named more than once")
        return self

    def under(self, folder: Path) -> GatewayConfig:
        """The same with relative paths taken from `folder`."""
        return self.model_copy(update={"bus_tls": self.bus_tls and self.bus_tls.under(folder)})
