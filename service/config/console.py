"""The operator's console: where it listens, and who may do what there."""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.address import HostPort, host_and_port, is_loopback
from lumpwatch.service.config.base import PositiveSeconds, Strict
from lumpwatch.service.config.bus import TlsConfig

RoleName = Literal["viewer", "operator", "engineer"]
Header = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9-]{0,63}$")]


class UserRole(IntEnum):
    """What a user of the console may do; each may do what those before it may."""

    VIEWER = 1
    """Sees everything."""
    OPERATOR = 2
    """Acknowledges, shelves, judges."""
    ENGINEER = 3
    """Changes regions, labels, trains, promotes."""

    @classmethod
    def named(cls, name: str) -> UserRole:
        """The role of that name in small letters; KeyError where there is none."""
        return cls[name.upper()]

    @property
    def label(self) -> str:
        """Its name in small letters."""
        return self.name.lower()


class ConsoleTlsConfig(Strict):
    """The certificate that browsers see."""

    certificate: Path
    """Certificate chain (PEM)."""
    key: Path
    """Its private key (PEM)."""


class ProxyConfig(Strict):
    """A reverse proxy that has made sure who the user is, by OpenID Connect for example."""

    trusted: Annotated[tuple[str, ...], Field(min_length=1)] = ("127.0.0.1", "::1")
    """Addresses of the proxy; the headers of all others are ignored."""
    user_header: Header = "X-Forwarded-User"
    """Header with the user's name; the proxy must remove it from what browsers send."""
    groups_header: Header = "X-Forwarded-Groups"
    """Header with the user's groups, separated by commas."""
    operators: tuple[str, ...] = ()
    """Groups whose members are operators."""
    engineers: tuple[str, ...] = ()
    """Groups whose members are engineers; everyone else that the proxy lets through is a viewer."""


class ConsoleConfig(Strict):
    """The web page for operators and commissioning engineers (`lumpwatch console`)."""

    listen: HostPort = "127.0.0.1:8080"
    """`host:port` of the page; port 0 takes a free one."""
    users: Path | None = None
    """File with users, made by `lumpwatch users`; a relative path begins at the configuration file."""
    anonymous: RoleName | None = None
    """Role of whoever has not logged in, on loopback only. Left out: `viewer` where there are neither `users` nor
    `proxy`, else nobody gets in."""
    proxy: ProxyConfig | None = None
    """A reverse proxy that says who the user is."""
    tls: ConsoleTlsConfig | None = None
    """Serve by HTTPS."""
    allow_http: bool = False
    """Serve by plain HTTP to other hosts as well: only where something before the console keeps its port from the
    network, such as a proxy, or a container's port that is published on loopback alone."""
    names: tuple[str, ...] = ()
    """Host names by which browsers may call the console beside its address; left out with a wildcard address: all."""
    session_s: PositiveSeconds = 43_200.0
    """How long a login lasts; a shift by default."""
    bus_tls: TlsConfig | None = None
    """The console's own certificate on the bus, to be named in `bus.access.operators`; left out: `bus.tls`."""
    clips_mb: int = Field(default=512, ge=16, le=1_000_000)
    """Room for clips that were made playable for browsers, MiB; the oldest go first."""
    work_mb: int = Field(default=4096, ge=64, le=1_000_000)
    """Room for uploaded videos and what work on them makes, MiB."""

    @model_validator(mode="after")
    def _closed(self) -> Self:
        if self.loopback:
            return self
        if self.anonymous is not None:
            raise ValueError("anonymous needs a loopback address in listen: anyone could act")
        if self.users is None and self.proxy is None:
            raise ValueError("an address that others reach needs users or proxy")
        if self.tls is None and not self.allow_http:
            raise ValueError("an address that others reach needs tls (or allow_http behind a proxy)")
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.listen)

    @property
    def loopback(self) -> bool:
        """Whether only this host reaches it."""
        return is_loopback(self.address[0])

    @property
    def visitor(self) -> UserRole | None:
        """Role of whoever has not logged in; None: nobody gets in."""
        if self.anonymous is not None:
            return UserRole.named(self.anonymous)
        return UserRole.VIEWER if self.users is None and self.proxy is None else None

    def under(self, folder: Path) -> ConsoleConfig:
        """The same with relative paths taken from `folder`."""
        tls = self.tls and ConsoleTlsConfig(
            certificate=folder / self.tls.certificate, key=folder / self.tls.key
        )
        return self.model_copy(
            update={
                "users": self.users and folder / self.users,
                "tls": tls,
                "bus_tls": self.bus_tls and self.bus_tls.under(folder),
            }
        )
