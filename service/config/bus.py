"""How the daemon takes part in the zenoh network."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import StringConstraints, model_validator

from service.config.base import PositiveSeconds, Strict

Endpoint = Annotated[
    str, StringConstraints(pattern=r"^(tcp|udp|tls|quic|ws|unixsock-stream)/[^\s/]+(:\d{1,5})?(/[^\s]*)?$")
]


class BusConfig(Strict):
    """The daemon is the hub (`router`, the default) or joins one that exists (`client`)."""

    mode: Literal["router", "client"] = "router"
    """`router`: the daemon is the hub that others join. `client`: it joins the hub in `connect`."""
    listen: tuple[Endpoint, ...] = ("tcp/127.0.0.1:7447",)
    """Endpoints on which the hub listens (router mode)."""
    connect: tuple[Endpoint, ...] = ()
    """Endpoints to join: other routers (router mode) or the hub (client mode)."""
    shared_memory: bool = True
    """Let frames travel through shared memory between processes of one host."""
    connect_timeout_s: PositiveSeconds = 10.0
    """How long a process tries its first connection before it says so and tries again."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.mode == "router" and not self.listen:
            raise ValueError("mode router needs at least one endpoint in listen")
        if self.mode == "client" and not self.connect:
            raise ValueError("mode client needs at least one endpoint in connect")
        return self

    @property
    def hub(self) -> tuple[str, ...]:
        """The endpoints that the daemon's own processes connect to as clients."""
        return self.listen if self.mode == "router" else self.connect
