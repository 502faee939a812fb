"""How sessions are opened: the hub in this process, or a client of a hub."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import socket
import threading
import uuid
from collections.abc import Iterable
from pathlib import Path

import zenoh

from lumpwatch.service.bus.access import Commandable, access_control
from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.cut_off import watch_sessions
from lumpwatch.service.bus.errors import BusClosed, BusError
from lumpwatch.service.bus.handles import reason
from lumpwatch.service.config import BusConfig, TlsConfig

_log = logging.getLogger(__name__)

_ENDPOINT = re.compile(r"(?P<protocol>\w[\w-]*)/(?P<host>\[[^\]]*\]|[^:/?#\[\]]*):(?P<port>\d+)(?P<rest>.*)")
_ANY_HOST = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]", "*": "127.0.0.1"}
_FIRST_ATTEMPT_S, _LONGEST_ATTEMPT_S, _PAUSE_S = 0.5, 4.0, 0.2
# With zenoh's own values a client is back 2.5 to 3.5 s after its hub, with these after some 0.1 s.
_RETRY = {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5}

_ACCEPT_MS, _MOST_PENDING = 3000, 2000
_ALARMS_QUEUED = 16
MOST_BYTES = 64 << 20
"""A longer message ends the connection that it comes from: a colour picture of 5,000 by 4,000 pixels fits."""


def open_hub(config: BusConfig, commands: Iterable[Commandable] = ()) -> Bus:
    """Be the hub: a router in this process that listens on all of `config.listen`.

    An endpoint with port 0 gets a free port; `Bus.endpoints` says what became of it, and names
    loopback for wildcard hosts, so it is what clients on this host connect to. Other routers in
    `config.connect` are joined in the background. Where `config.access` says who may do what, nobody
    may give other `commands` than these. Raises BusError when any endpoint cannot be listened on.
    """
    if config.mode != "router":
        raise BusError("bus: mode client has no hub of its own")
    listen = with_ports(config.listen)
    settings = _settings(config, "router", listen=listen, connect=config.connect)
    if config.access is not None:
        settings.insert_json5("access_control", json.dumps(access_control(config.access, commands)))
    try:
        session = zenoh.open(settings)
    except zenoh.ZError as error:
        named = [endpoint for endpoint in listen if endpoint in str(error)] or listen
        raise BusError(f"bus: cannot listen on {', '.join(named)}: {reason(error)}") from error
    return Bus(session, host_clock(), reachable(listen), watch_sessions(session, listen, config))


def open_client(config: BusConfig, stop: threading.Event | None = None, *, wait: bool = True) -> Bus:
    """Be a client of `config.joined`; wildcard hosts mean this host.

    With `wait` it tries until the hub is there, says so in the log after `connect_timeout_s`, and raises
    BusClosed within some 4 s after `stop` is set; without, it raises BusError after `connect_timeout_s`.
    Once open, the session finds its hub again by itself. Raises BusError at once for a port 0.
    """
    endpoints = reachable(config.joined)
    if without := [endpoint for endpoint in endpoints if endpoint.endswith(":0")]:
        raise BusError(f"bus: cannot connect to {without[0]}: the hub must be given by its real port")
    stop = stop or threading.Event()
    attempt_s = min(_FIRST_ATTEMPT_S, config.connect_timeout_s) if wait else config.connect_timeout_s
    tried_s, logged = 0.0, False
    while not stop.is_set():
        try:
            session = zenoh.open(_settings(config, "client", connect=endpoints, timeout_s=attempt_s))
        except zenoh.ZError as error:
            problem = f"bus: cannot connect to {', '.join(endpoints)}: {reason(error)}"
            if not wait:
                raise BusError(problem) from error
            tried_s += attempt_s + _PAUSE_S
            if tried_s >= config.connect_timeout_s and not logged:
                _log.warning("%s; trying on", problem)
                logged = True
            # Attempts grow: a far hub may need longer for one, a stop is noticed soon at first.
            attempt_s = min(2 * attempt_s, _LONGEST_ATTEMPT_S)
            stop.wait(_PAUSE_S)
        else:
            return Bus(session, host_clock(), endpoints)
    raise BusClosed(f"bus: stopped before {', '.join(endpoints)} was there")


def with_ports(endpoints: Iterable[str]) -> tuple[str, ...]:
    """The endpoints with port 0 replaced by one that is free now."""
    return tuple(_with_port(endpoint) for endpoint in endpoints)


def reachable(endpoints: Iterable[str]) -> tuple[str, ...]:
    """The endpoints with wildcard hosts replaced by loopback."""
    return tuple(_with_host(endpoint) for endpoint in endpoints)


def host_clock(boot_id: Path = Path("/proc/sys/kernel/random/boot_id")) -> str:
    """A name for the monotonic clock: the same for all processes of one boot of one host."""
    try:
        seed = boot_id.read_bytes()
    except OSError:
        seed = uuid.uuid4().bytes  # unknown host: better no shared clock than a wrong one
    return hashlib.sha256(seed).hexdigest()[:16]


def _settings(
    config: BusConfig,
    mode: str,
    *,
    listen: tuple[str, ...] = (),
    connect: tuple[str, ...] = (),
    timeout_s: float | None = None,
) -> zenoh.Config:
    zenoh.init_log_from_env_or("off")  # silent unless RUST_LOG asks for more
    settings = zenoh.Config()
    values: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "listen/endpoints": listen,
        "listen/exit_on_failure": True,
        "listen/timeout_ms": 0,
        "connect/endpoints": connect,
        "connect/retry": _RETRY,
        "timestamping/enabled": True,
        # So many alarms wait for a slow reader before anybody waits with them.
        "transport/link/tx/queue/size/interactive_high": _ALARMS_QUEUED,
        "transport/link/rx/max_message_size": MOST_BYTES,
        # Connections that say nothing must not take the places of those that join.
        "transport/unicast/accept_timeout": _ACCEPT_MS,
        "transport/unicast/accept_pending": _MOST_PENDING,
        "transport/unicast/max_sessions": config.hub.sessions,
        "transport/shared_memory/enabled": config.shared_memory,
    }
    if config.tls is not None:
        values |= _certificates(config.tls)
    if timeout_s is not None:
        values["connect/timeout_ms"] = max(1, round(timeout_s * 1000))
    for name, value in values.items():
        settings.insert_json5(name, json.dumps(value))
    return settings


def _certificates(tls: TlsConfig) -> dict[str, object]:
    """Both sides of every link show a certificate. Raises BusError for a file that cannot be read."""
    for name, file in tls:
        try:
            Path(file).read_bytes()
        except OSError as error:
            raise BusError(f"bus.tls.{name}: {file}: cannot be read ({error.strerror})") from error
    names = {
        "root_ca_certificate": tls.ca,
        "listen_certificate": tls.certificate,
        "listen_private_key": tls.key,
        "connect_certificate": tls.certificate,
        "connect_private_key": tls.key,
    }
    values: dict[str, object] = {f"transport/link/tls/{name}": str(file) for name, file in names.items()}
    return {
        **values,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/close_link_on_expiration": True,
    }


def _with_port(endpoint: str) -> str:
    """Port 0 replaced by a free one: zenoh would take one, but not tell which."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or int(match["port"]) != 0:
        return endpoint
    family = socket.AF_INET6 if match["host"].startswith("[") else socket.AF_INET
    kind = socket.SOCK_DGRAM if match["protocol"] in ("udp", "quic") else socket.SOCK_STREAM
    try:
        with socket.socket(family, kind) as probe:
            probe.bind((match["host"].strip("[]"), 0))
            port = probe.getsockname()[1]
    except OSError as error:
        raise BusError(f"bus: cannot listen on {endpoint}: {error.strerror}") from error
    return f"{match['protocol']}/{match['host']}:{port}{match['rest']}"


def _with_host(endpoint: str) -> str:
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or match["host"] not in _ANY_HOST:
        return endpoint
    return f"{match['protocol']}/{_ANY_HOST[match['host']]}:{match['port']}{match['rest']}"
