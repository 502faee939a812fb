"""The hub's process as the daemon keeps it, without a process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from lumpwatch.service.bus import BusError
from lumpwatch.service.config import BusConfig
from lumpwatch.service.runtime.hub_keeper import HubKeeper
from lumpwatch.service.telemetry import Relay, Report
from tests.runtime.fakes import FakeSystem, soon


class Hub:
    """A keeper, the processes that it starts, and what it says of their ends."""

    def __init__(self, said: Callable[[Hub], object] = lambda _: None) -> None:
        """`said` is what the process says while it is waited for."""
        self._said = said
        self.system = FakeSystem()
        self.ends: list[tuple[str, str, str]] = []
        self.keeper = HubKeeper(
            BusConfig(listen=("tcp/127.0.0.1:0",)),
            Relay(),
            lambda *told: self.ends.append(told),
            start=self.system.start,
        )

    def say(self, state: str, problem: str = "") -> None:
        """The newest process reports."""
        self.system.newest("hub").line.send(Report(time.monotonic(), "", state, {}, problem))

    def start(self, stop: threading.Event) -> list[Exception]:
        """Start it while the process says something; gives what was raised."""
        raised: list[Exception] = []

        def go() -> None:
            try:
                self.keeper.start(stop)
            except BusError as error:
                raised.append(error)

        thread = threading.Thread(target=go)
        thread.start()
        soon(lambda: "hub" in self.system.processes)
        self._said(self)
        thread.join(timeout=20.0)
        assert not thread.is_alive()
        return raised


def test_the_start_waits_until_it_listens_on_a_real_port() -> None:
    def said(hub: Hub) -> None:
        hub.say("starting")
        hub.say("running")

    hub = Hub(said)
    (endpoint,) = hub.keeper.endpoints
    assert not endpoint.endswith(":0")
    assert hub.start(threading.Event()) == []
    assert hub.system.newest("hub").is_alive()


def test_why_it_cannot_listen_is_raised() -> None:
    (raised,) = Hub(lambda hub: hub.say("starting", "bus: cannot listen: in use")).start(threading.Event())
    assert str(raised) == "bus: cannot listen: in use"


def test_a_stop_ends_the_waiting() -> None:
    stop = threading.Event()
    assert Hub(lambda _: stop.set()).start(stop) == []


def test_one_that_ends_is_started_anew_with_the_same_addresses() -> None:
    hub = Hub(lambda hub: hub.say("running"))
    before = hub.keeper.endpoints
    hub.start(threading.Event())
    hub.system.newest("hub").end(-6)
    hub.keeper.watch()
    assert hub.ends == [("", "hub", "exited")]

    def again() -> bool:
        hub.keeper.watch()
        return len(hub.system.processes["hub"]) == 2

    soon(again)
    assert hub.keeper.endpoints == before
    hub.system.newest("hub").end(0)
    assert hub.keeper.stop() == ()
