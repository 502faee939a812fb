"""The gateway to the plant's control system: what it serves there, and to whom."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, IPvAnyNetwork, SecretStr, model_validator

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


class MqttTlsConfig(Strict):
    """How the broker is believed, and who the gateway is there. Relative paths begin at the configuration file."""

    ca: Path
    """Certificate of the authority that signed the broker's (PEM)."""
    certificate: Path | None = None
    """The gateway's own certificate (PEM)."""
    key: Path | None = None
    """Its private key (PEM)."""

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together")
        return self

    def under(self, folder: Path) -> MqttTlsConfig:
        """The same with relative paths taken from `folder`."""
        certificate, key = self.certificate, self.key
        return MqttTlsConfig(
            ca=folder / self.ca, certificate=certificate and folder / certificate, key=key and folder / key
        )


TopicPart = Annotated[str, Field(pattern=r"^[^/+#\x00-\x1f]{1,64}$")]


class SparkplugConfig(Strict):
    """An edge node of Sparkplug B, with all values of the register map as its metrics."""

    group: TopicPart
    """Group ID."""
    node: TopicPart | None = None
    """Edge node ID; left out: the name of the site."""


class MqttConfig(Strict):
    """A client of an MQTT broker (3.1.1)."""

    broker: HostPort
    """`host:port` of the broker, usually port 1883, or 8883 with `tls`."""
    topic: Annotated[str, Field(pattern=r"^[^+#\x00-\x1f]{1,128}$")] = "lumpwatch"
    """What topics begin with; the site's name follows."""
    user: Annotated[str, Field(min_length=1, max_length=128)] | None = None
    """User name at the broker."""
    password: SecretStr | None = None
    """Password at the broker, as `${VARIABLE}`."""
    tls: MqttTlsConfig | None = None
    """Talk by TLS."""
    insecure: bool = False
    """Talk to another host without `tls`: everyone on the way may read, and forge what the broker says."""
    commands: bool = False
    """Take acknowledgements and plant signals from the broker. It must say who may write them."""
    sparkplug: SparkplugConfig | None = None
    """Be an edge node of Sparkplug B as well."""

    @model_validator(mode="after")
    def _closed(self) -> Self:
        host, port = self.address
        if port == 0:
            raise ValueError("broker: port 0 leads nowhere")
        if not is_loopback(host) and self.tls is None and not self.insecure:
            raise ValueError("a broker on another host needs tls (or insecure: true)")
        if self.password is not None and self.user is None:
            raise ValueError("password needs user")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.broker)

    def under(self, folder: Path) -> MqttConfig:
        """The same with relative paths taken from `folder`."""
        return self.model_copy(update={"tls": self.tls and self.tls.under(folder)})


class OpcUaConfig(Strict):
    """OPC UA server; needs the extra `opcua`."""

    listen: HostPort = "127.0.0.1:4840"
    """`host:port` of the server."""
    certificate: Path | None = None
    """The server's certificate (RSA, PEM) with the URI `urn:lumpwatch:SITE:gateway`; with it everything is signed and
    encrypted (Basic256Sha256, Aes256_Sha256_RsaPss), without it nothing is. `certificates.sh` makes it."""
    key: Path | None = None
    """Its private key (PEM)."""
    users: dict[Annotated[str, Field(min_length=1, max_length=64)], SecretStr] = Field(default_factory=dict)
    """Users with their passwords, as `${VARIABLE}`: they may acknowledge and shelve."""
    anonymous: bool = True
    """Whether everyone else may read."""

    @model_validator(mode="after")
    def _closed(self) -> Self:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together")
        host, port = self.address
        if port == 0:
            raise ValueError("listen: port 0 cannot be told to clients")
        if self.certificate is None and not is_loopback(host):
            raise ValueError("an address that others reach needs certificate and key")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.listen)

    def under(self, folder: Path) -> OpcUaConfig:
        """The same with relative paths taken from `folder`."""
        certificate, key = self.certificate, self.key
        return self.model_copy(
            update={"certificate": certificate and folder / certificate, "key": key and folder / key}
        )


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
    opcua: OpcUaConfig | None = None
    """Serve OPC UA."""
    mqtt: MqttConfig | None = None
    """Publish to an MQTT broker."""
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
        return self.model_copy(
            update={
                "bus_tls": self.bus_tls and self.bus_tls.under(folder),
                "opcua": self.opcua and self.opcua.under(folder),
                "mqtt": self.mqtt and self.mqtt.under(folder),
            }
        )
