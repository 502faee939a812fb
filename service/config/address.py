"""Where something listens, as `host:port`."""

from __future__ import annotations

import ipaddress
from typing import Annotated

from pydantic import AfterValidator

from lumpwatch.service.core import whole_number


def _checked(value: str) -> str:
    host, _, port = value.rpartition(":")
    if not host or whole_number(port, 65535) is None:
        raise ValueError(f"'{value}' is not host:port")
    return value


HostPort = Annotated[str, AfterValidator(_checked)]
"""An address to listen at; port 0 takes a free one."""


def host_and_port(address: str) -> tuple[str, int]:
    """The two parts of a `HostPort`."""
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)


def is_loopback(host: str) -> bool:
    """Whether only this host reaches it; a name other than `localhost` may lead anywhere."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
