"""How the daemon takes part in the zenoh network."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from lumpwatch.service.config.address import is_loopback
from lumpwatch.service.config.base import PositiveSeconds, Strict

Endpoint = Annotated[
    str, StringConstraints(pattern=r"^(tcp|udp|tls|quic|ws|unixsock-stream)/[^\s/]+(:\d{1,5})?(/[^\s]*)?$")
]

CommonName = Annotated[str, StringConstraints(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f/]+$")]


class TlsConfig(Strict):
    """Certificates for endpoints that begin with `tls/` or `quic/`; both sides must show one.

    Relative paths begin at the configuration file. `deploy/security/certificates.sh` makes the files.
    """

    ca: Path
    """Certificate of the site's own authority (PEM): whom this process believes."""
    certificate: Path
    """Certificate of this process (PEM); its common name is what `access` goes by."""
    key: Path
    """Private key of the certificate (PEM, PKCS #8), readable by this process alone."""

    def under(self, folder: Path) -> TlsConfig:
        """The same with relative paths taken from `folder`."""
        return TlsConfig(ca=folder / self.ca, certificate=folder / self.certificate, key=folder / self.key)


class AccessConfig(Strict):
    """Who may do what on the bus, by the common name of the client's certificate.

    Everyone with a certificate of the site may read. Whatever is not allowed here is dropped by the hub.
    """

    daemons: Annotated[tuple[CommonName, ...], Field(min_length=1)] = ("lumpwatch",)
    """Camera and monitor processes, and other routers: the only ones that publish frames, states, alarms."""
    operators: tuple[CommonName, ...] = ()
    """May acknowledge, shelve, take out of service, and judge alarms."""
    plants: tuple[CommonName, ...] = ()
    """Plant control: may suppress alarms by its signals."""
    gateways: tuple[CommonName, ...] = ()
    """Gateways to the plant's control system: may pass on its signals, acknowledgements and shelvings."""

    @model_validator(mode="after")
    def _one_role(self) -> Self:
        names = [*self.daemons, *self.operators, *self.plants, *self.gateways]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"'{min(twice)}' is named more than once")
        return self


class HubConfig(Strict):
    """What the hub's own process may use (router mode)."""

    memory_mib: Annotated[int, Field(ge=64, le=65536)] = 384
    """How much memory the hub may take beyond what it has at its start. It ends where it would need more, and is
    started again within some seconds; regions are BLIND where it is away for longer than `blind_after_s`."""
    sessions: Annotated[int, Field(ge=8, le=10_000)] = 500
    """How many sessions there may be at once, two of them for each camera."""
    guests: Annotated[int, Field(ge=1, le=10_000)] = 100
    """How many of them, with `access`, may be of others than `daemons`; the newest beyond are cut off. One that sends
    more than 4 MiB at once, or 64 KiB a second for long, is cut off too."""

    @model_validator(mode="after")
    def _room(self) -> Self:
        if self.guests >= self.sessions:
            raise ValueError(
                f"guests ({self.guests}) must leave room for daemons in sessions ({self.sessions})"
            )
        return self


def _is_local(endpoint: str) -> bool:
    """Whether only this host reaches it, or only with a certificate."""
    protocol, _, rest = endpoint.partition("/")
    if protocol in ("tls", "quic", "unixsock-stream"):
        return True
    host = rest.split("#")[0].split("?")[0].split("/")[0].rpartition(":")[0].strip("[]")
    return is_loopback(host)


class BusConfig(Strict):
    """The daemon is the hub (`router`, the default) or joins one that exists (`client`)."""

    mode: Literal["router", "client"] = "router"
    """`router`: the daemon is the hub that others join. `client`: it joins the hub in `connect`."""
    listen: tuple[Endpoint, ...] = ("tcp/127.0.0.1:7447",)
    """Endpoints on which the hub listens (router mode). Without `tls` every program on this host may read, command and
    forge."""
    connect: tuple[Endpoint, ...] = ()
    """Endpoints to join: other routers (router mode) or the hub (client mode)."""
    shared_memory: bool = True
    """Let frames travel through shared memory between processes of one host."""
    connect_timeout_s: PositiveSeconds = 10.0
    """How long a process tries its first connection before it says so and tries again."""
    insecure: bool = False
    """Listen beyond loopback without `tls`: everyone who reaches the address may read, command and forge."""
    tls: TlsConfig | None = None
    """Certificates; needed by endpoints that begin with `tls/` or `quic/`."""
    access: AccessConfig | None = None
    """Who may do what (router mode, with `tls`); without it everyone who can connect may do everything."""
    hub: HubConfig = HubConfig()
    """What the hub's own process may use."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.mode == "router" and not self.listen:
            raise ValueError("mode router needs at least one endpoint in listen")
        if self.mode == "client" and not self.connect:
            raise ValueError("mode client needs at least one endpoint in connect")
        return self

    @model_validator(mode="after")
    def _secured(self) -> Self:
        secured = [endpoint.startswith(("tls/", "quic/")) for endpoint in (*self.listen, *self.connect)]
        if any(secured) and self.tls is None:
            raise ValueError("an endpoint that begins with tls/ or quic/ needs bus.tls")
        if self.mode == "router" and self.access is not None and not all(secured[: len(self.listen)]):
            # Whoever comes without a certificate has no name to go by.
            raise ValueError("access needs endpoints in listen that begin with tls/ or quic/")
        return self

    @model_validator(mode="after")
    def _kept_in(self) -> Self:
        open_ones = [endpoint for endpoint in self.listen if not _is_local(endpoint)]
        if self.mode == "router" and open_ones and not self.insecure:
            raise ValueError(
                f"listen: {open_ones[0]} can be reached from beyond this host, and without bus.tls by everyone; "
                "use tls/ with bus.tls, a loopback address, or bus.insecure: true"
            )
        return self

    @property
    def joined(self) -> tuple[str, ...]:
        """The endpoints that the daemon's own processes connect to as clients."""
        return self.listen if self.mode == "router" else self.connect
