"""Opening and closing: what fails, how it says so, and that it does not hang."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from pathlib import Path

import pytest

from lumpwatch.service.bus.errors import BusClosed, BusError
from lumpwatch.service.bus.session import host_clock, open_client, open_hub, reachable
from lumpwatch.service.config.bus import BusConfig
from tests.bus.test_bus_support import Child, client_config, eventually, free_endpoint, hub_config, repeat


def test_a_port_in_use_is_an_error_that_names_it() -> None:
    endpoint = free_endpoint()
    with open_hub(hub_config(endpoint)), pytest.raises(BusError) as caught:
        open_hub(BusConfig(listen=(free_endpoint(), endpoint)))
    assert str(caught.value).startswith(f"bus: cannot listen on {endpoint}: ")


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/192.0.2.1:7447", "tcp/192.0.2.1:0", "tcp/127.0.0.1", "udp/192.0.2.1:7447", "tcp/[::g]:1"],
)
def test_an_endpoint_that_cannot_be_had_is_an_error_of_one_line(endpoint: str) -> None:
    with pytest.raises(BusError, match=r"^bus: cannot listen on [^\n]+$") as caught:
        open_hub(hub_config(endpoint))
    assert endpoint.split(":")[0] in str(caught.value)
    assert "/src/" not in str(caught.value)


def test_client_mode_has_no_hub() -> None:
    with pytest.raises(BusError, match="mode client"):
        open_hub(client_config(free_endpoint()))


def test_wildcard_hosts_and_port_zero_become_what_clients_connect_to() -> None:
    with open_hub(hub_config("tcp/0.0.0.0:0")) as hub:
        (endpoint,) = hub.endpoints
        host, _, port = endpoint.rpartition(":")
        assert host == "tcp/127.0.0.1"
        assert int(port) > 0
        with open_client(client_config(endpoint), wait=False) as client:
            assert client.endpoints == hub.endpoints
        with open_client(client_config(f"tcp/0.0.0.0:{port}"), wait=False) as client:
            assert client.endpoints == hub.endpoints


def test_reachable_changes_wildcards_only() -> None:
    given = (
        "tcp/0.0.0.0:1",
        "tls/[::]:2#so_sndbuf=1",
        "tcp/10.0.0.5:3",
        "tcp/hub:4",
        "unixsock-stream//run/l",
    )
    assert reachable(given) == (
        (
            "tcp/127.0.0.1:1",
            "tls/[::1]:2#so_sndbuf=1",
            "tcp/10.0.0.5:3",
            "tcp/hub:4",
            "unixsock-stream//run/l",
        )
    )


def test_connecting_to_port_zero_is_an_error() -> None:
    with pytest.raises(BusError, match=r"tcp/127\.0\.0\.1:0: "):
        open_client(hub_config("tcp/127.0.0.1:0"))


def test_an_unreachable_hub_is_an_error_that_names_it() -> None:
    endpoint = free_endpoint()
    config = client_config(endpoint).model_copy(update={"connect_timeout_s": 0.3})
    with pytest.raises(BusError, match=f"cannot connect to {endpoint}"):
        open_client(config, wait=False)


def test_waiting_for_a_hub_says_so_and_ends_when_stopped(caplog: pytest.LogCaptureFixture) -> None:
    config = client_config(free_endpoint()).model_copy(update={"connect_timeout_s": 0.2})
    stop = threading.Event()
    raised: list[BaseException] = []

    def wait() -> None:
        try:
            open_client(config, stop)
        except BusClosed as error:
            raised.append(error)

    waiting = threading.Thread(target=wait)
    waiting.start()
    eventually(lambda: "trying on" in caplog.text)
    stop.set()
    waiting.join(30)
    assert len(raised) == 1
    assert caplog.text.count("trying on") == 1


def test_a_client_may_start_before_its_hub() -> None:
    endpoint = free_endpoint()
    opened: list[bool] = []

    def wait() -> None:
        with open_client(client_config(endpoint)) as bus:
            opened.append(bus.closed)

    waiting = threading.Thread(target=wait)
    waiting.start()
    time.sleep(0.7)
    assert opened == []
    with open_hub(hub_config(endpoint)):
        waiting.join(30)
    assert opened == [False]


def test_a_client_knows_whether_its_hub_is_there() -> None:
    endpoint = free_endpoint()
    with Child("hub", endpoint) as hub, open_client(client_config(endpoint)) as client:
        assert client.connected
        hub.process.kill()
        hub.process.wait()
        eventually(lambda: not client.connected)
        with Child("hub", endpoint):
            eventually(lambda: client.connected)
    assert not client.connected


def test_a_closed_bus_says_so() -> None:
    with open_hub(hub_config("tcp/127.0.0.1:0")) as bus:
        publisher = bus.publisher("k")
        publisher.put(b"1")
    assert bus.closed
    bus.close()
    with pytest.raises(BusClosed):
        bus.publisher("k")
    with pytest.raises(BusClosed):
        bus.ask("k")
    with pytest.raises(BusClosed):
        publisher.put(b"2")


def test_a_bad_key_is_an_error_that_names_it() -> None:
    with open_hub(hub_config("tcp/127.0.0.1:0")) as bus:
        for use in (
            bus.publisher,
            bus.alarm_publisher,
            bus.frame_publisher,
            bus.frame_inbox,
            bus.alive,
            bus.ask,
        ):
            with pytest.raises(BusError, match="bad//key"):
                use("bad//key")
        before = threading.active_count()
        with pytest.raises(BusError, match="bad//key"):
            bus.subscribe("bad//key", lambda _key, _payload: None)
        eventually(lambda: threading.active_count() == before)


def test_close_does_not_wait_for_a_callback_that_hangs() -> None:
    endpoint = free_endpoint()
    entered, release = threading.Event(), threading.Event()

    def hang(_key: str, _payload: bytes) -> None:
        entered.set()
        release.wait()

    with open_hub(hub_config(endpoint)) as hub:
        client = open_client(client_config(endpoint))
        client.subscribe("k", hang)
        publisher = hub.publisher("k")
        repeat(lambda: publisher.put(b"1"), entered.is_set)
        closing = threading.Thread(target=client.close)
        closing.start()
        closing.join(20)
        still_closing = closing.is_alive()
        release.set()
    assert not still_closing


def test_close_from_a_callback() -> None:
    endpoint = free_endpoint()
    with open_hub(hub_config(endpoint)) as hub:
        client = open_client(client_config(endpoint))
        client.subscribe("k", lambda _key, _payload: client.close())
        publisher = hub.publisher("k")
        repeat(lambda: publisher.put(b"1"), lambda: client.closed)


def test_the_interpreter_exits_with_a_busy_session_left_open() -> None:
    endpoint = free_endpoint()
    with open_hub(hub_config(endpoint)) as hub, Child("abandon", endpoint, "k") as child:
        publisher = hub.publisher("k")
        stop = threading.Event()

        def flood() -> None:
            while not stop.is_set():
                publisher.put(b"1")
                time.sleep(0.0005)

        flooding = threading.Thread(target=flood)
        flooding.start()
        try:
            time.sleep(0.3)
            assert child.process.stdin is not None
            child.process.stdin.close()
            assert child.process.wait(30) == 0
        finally:
            stop.set()
            flooding.join()


def test_host_clock_is_that_of_the_boot(tmp_path: Path) -> None:
    one, two, none = tmp_path / "one", tmp_path / "two", tmp_path / "none"
    one.write_text("2f6a0c1e")
    two.write_text("9b1d7e44")
    assert host_clock(one) == host_clock(one)
    assert host_clock(one) != host_clock(two)
    assert host_clock(none) != host_clock(none)


def test_connections_that_say_nothing_keep_nobody_out() -> None:
    """150 of them (100 kept everybody else out for 10 s), and the hub lets go of them by itself."""
    endpoint = free_endpoint()
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with contextlib.ExitStack() as stack:
        stack.enter_context(open_hub(hub_config(endpoint)))
        idle = [stack.enter_context(socket.create_connection((host, int(port)), 10.0)) for _ in range(150)]
        began = time.monotonic()
        with open_client(client_config(endpoint), wait=False):
            assert time.monotonic() - began < 2.0
        idle[0].settimeout(15.0)
        assert idle[0].recv(1) == b""
