"""TLS with certificates on both sides, and who may do what: real sessions over a real hub."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from lumpwatch.service.bus.access import INTERNAL, READABLE, access_control
from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.endpoints import Handler
from lumpwatch.service.bus.errors import BusError
from lumpwatch.service.bus.keys import Keys, Kind
from lumpwatch.service.bus.session import open_client, open_hub
from lumpwatch.service.config import load_config, parse_config
from lumpwatch.service.config.bus import AccessConfig, BusConfig, TlsConfig
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import COMMANDS
from tests.bus.test_bus_support import eventually, free_endpoint
from tests.bus.tokens import Tokens
from tests.service_helpers import site_tree

SCRIPT = Path(__file__).parents[2] / "deploy" / "security" / "certificates.sh"
KEYS = Keys("north-pit")
ALARM, ACK, SUPPRESS = (
    KEYS.alarm("crusher-1", "apron"),
    KEYS.command("crusher-1", "apron", "ack"),
    KEYS.command("crusher-1", "apron", "suppress"),
)

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def make(folder: Path, name: str, *hosts: str) -> TlsConfig:
    """A certificate by the script that a site uses."""
    subprocess.run([SCRIPT, folder, name, *hosts], check=True, capture_output=True)
    return TlsConfig(ca=folder / "ca.pem", certificate=folder / f"{name}.pem", key=folder / f"{name}.key")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, TlsConfig]:
    folder = tmp_path_factory.mktemp("certificates")
    made = {name: make(folder, name) for name in ("anna", "plc", "gw", "guest")}
    made["lumpwatch"] = make(folder, "lumpwatch", "localhost")
    stranger = tmp_path_factory.mktemp("stranger")
    return made | {"stranger": make(stranger, "anna")}


@pytest.fixture(scope="module")
def endpoint() -> str:
    return free_endpoint().replace("tcp/", "tls/")


@pytest.fixture(scope="module")
def hub(site: dict[str, TlsConfig], endpoint: str) -> Iterator[Bus]:
    access = AccessConfig(operators=("anna",), plants=("plc",), gateways=("gw",))
    with open_hub(
        BusConfig(listen=(endpoint,), tls=site["lumpwatch"], access=access), COMMANDS.values()
    ) as bus:
        yield bus


def join(endpoint: str, tls: TlsConfig | None) -> Bus:
    config = BusConfig.model_construct(
        mode="client", connect=(endpoint,), listen=(), shared_memory=False, connect_timeout_s=1.0, tls=tls
    )
    return open_client(config, wait=False)


def outside(endpoint: str, tls: TlsConfig) -> zenoh.Session:
    """A program of somebody's own: it keeps to no rule of ours about what goes on which key."""
    config = zenoh.Config()
    values = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "transport/link/tls/root_ca_certificate": str(tls.ca),
        "transport/link/tls/connect_certificate": str(tls.certificate),
        "transport/link/tls/connect_private_key": str(tls.key),
        "transport/link/tls/enable_mtls": True,
    }
    for name, value in values.items():
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


@pytest.fixture
def monitor(hub: Bus, site: dict[str, TlsConfig], endpoint: str) -> Iterator[Bus]:
    with join(endpoint, site["lumpwatch"]) as bus:
        yield bus


def test_the_script_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run([SCRIPT, *arguments], capture_output=True, text=True)

    assert run().returncode == 2
    assert run(tmp_path, "a/b").returncode == 2
    assert run(tmp_path, "ca").returncode == 2
    assert run(tmp_path, "one").returncode == 0
    again = run(tmp_path, "one")
    assert again.returncode == 1
    assert "exists" in again.stderr
    assert (tmp_path / "one.key").stat().st_mode & 0o077 == 0
    assert (tmp_path / "ca.key").stat().st_mode & 0o077 == 0


def test_whoever_has_no_certificate_of_the_site_is_not_let_in(
    hub: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    with pytest.raises(BusError, match="cannot connect"):
        join(endpoint, site["stranger"])  # the same name, another authority
    with pytest.raises(BusError, match="cannot connect"):
        join(endpoint, None)
    with pytest.raises(BusError, match="cannot connect"):
        join(endpoint.replace("tls/", "tcp/"), None)


def test_a_client_certificate_is_not_taken_for_a_daemon(site: dict[str, TlsConfig]) -> None:
    endpoint = free_endpoint().replace("tcp/", "tls/")
    with (
        open_hub(BusConfig(listen=(endpoint,), tls=site["guest"])),
        pytest.raises(BusError, match="cannot connect"),
    ):
        join(endpoint, site["anna"])


def test_only_daemons_publish_alarms(
    hub: Bus, monitor: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    with join(endpoint, site["guest"]) as reader:
        seen: list[bytes] = []
        reader.subscribe_alarms(KEYS.alarms(), lambda _, payload: seen.append(payload))
        forgers = [join(endpoint, site[name]) for name in ("guest", "anna", "plc")]
        try:
            for forger in forgers:
                forger.alarm_publisher(ALARM).put(b"forged")
            for name in ("guest", "anna", "plc"):
                with outside(endpoint, site[name]) as session:
                    session.put(ALARM, b"forged")
                    session.delete(ALARM)
            real = monitor.alarm_publisher(ALARM)

            def heard() -> bool:
                real.put(b"real")
                return bool(seen)

            eventually(heard)
            assert set(seen) == {b"real"}
            with join(endpoint, site["guest"]) as late:
                kept = [reply.payload for reply in late.ask(KEYS.alarms())]
                assert kept
                assert set(kept) == {b"real"}
                history: list[bytes] = []
                late.subscribe_alarms(KEYS.alarms(), lambda _, payload: history.append(payload))
                eventually(lambda: len(history) >= len(kept))
                assert set(history) == {b"real"}
        finally:
            for forger in forgers:
                forger.close()


def test_only_operators_acknowledge(
    hub: Bus, monitor: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    asked: list[dict[str, str]] = []

    def take(parameters: dict[str, str], _: bytes | None) -> bytes:
        asked.append(parameters)
        return b"done"

    with closing(monitor.serve(ACK, take)), join(endpoint, site["anna"]) as anna:
        eventually(lambda: bool(anna.ask(ACK, {"actor": "anna"}, timeout_s=0.5)))
        before = len(asked)
        for name in ("guest", "plc"):
            with join(endpoint, site[name]) as other:
                assert not [one for one in other.ask(ACK, {"actor": name}, timeout_s=0.5) if one.payload]
                assert not [one for one in other.ask("lumpwatch/v1/**", timeout_s=0.5) if one.payload]
        assert asked[before:] == []


def test_a_gateway_passes_on_and_does_nothing_else(
    hub: Bus, monitor: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    asked: list[str] = []

    def takes(name: str) -> Handler:
        def take(_: dict[str, str], __: bytes | None) -> bytes:
            asked.append(name)
            return b"done"

        return take

    with ExitStack() as stack:
        for name in ("ack", "shelve", "suppress", "feed", "reset", "service", "verdict"):
            key = KEYS.command("crusher-1", "apron", name)
            stack.enter_context(closing(monitor.serve(key, takes(name))))
        gateway = stack.enter_context(join(endpoint, site["gw"]))

        def ask(name: str) -> bool:
            key = KEYS.command("crusher-1", "apron", name)
            return any(one.payload for one in gateway.ask(key, {"actor": "plc"}, timeout_s=0.5))

        for name in ("ack", "shelve", "suppress", "feed"):
            eventually(partial(ask, name))
        for name in ("reset", "service", "verdict"):
            assert not ask(name)
        assert {"reset", "service", "verdict"}.isdisjoint(asked)


def test_nobody_but_a_daemon_answers_for_the_site(
    hub: Bus, monitor: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    alive = "lumpwatch/v1/north-pit/@alive/**"
    with (
        join(endpoint, site["guest"]) as liar,
        join(endpoint, site["anna"]) as anna,
        Tokens(endpoint, alive, site["anna"]) as tokens,
    ):
        liar.serve(ACK, lambda *_: b"acknowledged, believe me")
        liar.alive(KEYS.alive("monitor", "crusher-1"))
        with closing(monitor.serve(ACK, lambda *_: b"true")):
            eventually(lambda: bool(anna.ask(ACK, {"actor": "anna"}, timeout_s=0.5)))
        assert [reply.payload for reply in anna.ask(ACK, {"actor": "anna"}, timeout_s=0.5)] == []
        assert tokens.present() == []
        with closing(monitor.alive(KEYS.alive("monitor", "crusher-1"))):
            eventually(lambda: tokens.present() != [])


def test_only_plant_control_suppresses(
    hub: Bus, monitor: Bus, site: dict[str, TlsConfig], endpoint: str
) -> None:
    seen: list[bytes] = []
    monitor.subscribe(SUPPRESS, lambda _, payload: seen.append(payload))
    with outside(endpoint, site["plc"]) as plc, outside(endpoint, site["anna"]) as anna:
        anna.put(SUPPRESS, b"anna")

        def heard() -> bool:
            plc.put(SUPPRESS, b"plc")
            return bool(seen)

        eventually(heard)
        assert set(seen) == {b"plc"}


def test_every_kind_of_key_has_its_readers_or_senders() -> None:
    assert sorted([*READABLE, *INTERNAL]) == sorted(Kind)


def test_commands_may_be_given_by_their_role_alone() -> None:
    rules: Any = access_control(AccessConfig(operators=("anna",), plants=("plc",)), COMMANDS.values())
    may = {
        rule["id"]: {one.rpartition("/")[2] for one in rule["key_exprs"]} - {"**"} for rule in rules["rules"]
    }
    assert may["command"] >= {"ack", "reset", "shelve", "unshelve", "service", "verdict", "proof"}
    assert may["signal"] == may["put"] == {"suppress", "feed"}
    assert may["pass_on"] == {"ack", "shelve", "unshelve"}
    assert {"evidence", "prior", "alarm", "state"} < may["read"]
    assert not may["read"] & (may["command"] | may["signal"])
    granted = {tuple(one["subjects"]): one["rules"] for one in rules["policies"]}
    assert granted[("operators",)] == ["command"]
    assert granted[("plants",)] == ["signal", "put"]
    assert granted[("everyone",)] == ["read", "receive"]


def test_a_hub_that_knows_no_commands_lets_nobody_give_any() -> None:
    rules: Any = access_control(AccessConfig(operators=("anna",)), ())
    assert [one["id"] for one in rules["rules"]] == ["everything", "read", "receive"]
    assert [one["subjects"] for one in rules["policies"]] == [["everyone"], ["daemons"]]


def test_zenoh_takes_the_access_control_without_operators_too() -> None:
    settings = zenoh.Config()
    rules = access_control(AccessConfig(), COMMANDS.values())
    settings.insert_json5("access_control", json.dumps(rules))
    assert "operators" not in settings.get_json("access_control")


def test_a_file_that_is_missing_is_named(tmp_path: Path, site: dict[str, TlsConfig]) -> None:
    tls = site["anna"].model_copy(update={"key": tmp_path / "none.key"})
    with pytest.raises(BusError, match=r"bus\.tls\.key: .*none\.key: cannot be read"):
        open_hub(BusConfig(listen=("tls/127.0.0.1:0",), tls=tls))


@pytest.mark.parametrize(
    ("bus", "problem"),
    [
        ({"listen": ["tls/127.0.0.1:7447"]}, "needs bus.tls"),
        ({"access": {"operators": ["anna"]}}, "access needs endpoints"),
        ({"access": {"operators": ["lumpwatch"]}}, "more than once"),
        ({"access": {"daemons": []}}, "daemons"),
    ],
)
def test_what_does_not_go_together_is_refused(bus: dict[str, object], problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        parse_config(json.dumps(site_tree() | {"bus": bus}))


def test_paths_begin_at_the_configuration_file(tmp_path: Path) -> None:
    tls = {"ca": "certs/ca.pem", "certificate": "/etc/one.pem", "key": "certs/one.key"}
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(site_tree() | {"bus": {"listen": ["tls/0.0.0.0:7447"], "tls": tls}}))
    config = load_config(file)
    assert config.bus.tls == TlsConfig(
        ca=tmp_path / "certs/ca.pem", certificate=Path("/etc/one.pem"), key=tmp_path / "certs/one.key"
    )
