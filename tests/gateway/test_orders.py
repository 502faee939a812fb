"""What the plant asks for, and what becomes of it on the bus, with a clock of the test's own."""

from __future__ import annotations

from typing import Any

import pytest

from lumpwatch.service.config import PlantConfig
from lumpwatch.service.core import AlarmClass
from lumpwatch.service.gateway.orders import Orders
from tests.gateway.site import REGION


class Bus:
    """Takes orders, or refuses them."""

    def __init__(self) -> None:
        self.now = 100.0
        self.taken: list[tuple[str, dict[str, Any]]] = []
        self.refuses: str | None = None
        self.orders = Orders(self.ask, PlantConfig(valid_s=9.0), "plc", lambda: self.now)

    def ask(self, region: tuple[str, str], command: str, parameters: dict[str, Any]) -> str | None:
        assert region == REGION
        if self.refuses is None:
            self.taken.append((command, parameters))
        return self.refuses

    def settled(self) -> list[tuple[str, dict[str, Any]]]:
        """What was taken since the last call, once there is nothing to pass on."""
        for _ in range(50):
            if not self.orders.pass_on():
                break
        else:
            raise AssertionError("it never ends")
        taken, self.taken = self.taken, []
        return taken


@pytest.fixture
def bus() -> Bus:
    return Bus()


def test_an_acknowledgement_is_passed_on_once_and_its_coil_falls_back(bus: Bus) -> None:
    for _ in range(1000):
        bus.orders.write(REGION, "ack", True)
    assert bus.orders.read(REGION, "ack")
    assert not bus.orders.read(REGION, "ack_blind")
    assert bus.settled() == [("ack", {"actor": "plc", "class": AlarmClass.LUMP})]
    assert not bus.orders.read(REGION, "ack")
    bus.orders.write(REGION, "ack", False)
    assert bus.settled() == []


def test_an_acknowledgement_that_is_refused_is_counted_and_not_repeated(bus: Bus) -> None:
    bus.refuses = "nobody answers"
    bus.orders.write(REGION, "ack_system", True)
    assert bus.settled() == []
    assert bus.orders.refused == 1
    assert not bus.orders.read(REGION, "ack_system")


def test_nothing_is_suppressed_before_the_plant_says_anything(bus: Bus) -> None:
    assert bus.settled() == []
    bus.orders.write(REGION, "maintenance", False)
    bus.orders.write(REGION, "feeder_runs", True)
    assert bus.settled() == [("feed", {"signal": "feeder", "valid_s": 9.0, "runs": True})]


def test_maintenance_suppresses_while_it_is_written_and_ends_by_itself(bus: Bus) -> None:
    bus.orders.write(REGION, "maintenance", True)
    first = bus.settled()
    assert [(c, p["class"], p["signal"], p["valid_s"]) for c, p in first] == [
        ("suppress", alarm_class, "maintenance", 9.0)
        for alarm_class in ("lump", "blind", "system", "blocked")
    ]
    for _ in range(20):  # written ten times a second: no news
        bus.now += 0.1
        bus.orders.write(REGION, "maintenance", True)
        assert bus.settled() == []
    bus.now += 2.0
    bus.orders.write(REGION, "maintenance", True)
    assert len(bus.settled()) == 4  # renewed
    bus.now += 8.9
    assert bus.orders.read(REGION, "maintenance")
    bus.now += 0.2  # the control system has died in maintenance
    assert not bus.orders.read(REGION, "maintenance")
    assert bus.settled() == []  # the bus' own validity has run out


def test_a_signal_that_is_taken_back_ends_the_suppression_at_once(bus: Bus) -> None:
    bus.orders.write(REGION, "maintenance", True)
    bus.settled()
    bus.now += 1.0
    bus.orders.write(REGION, "maintenance", False)
    assert [(p["class"], p["valid_s"]) for _, p in bus.settled()] == [
        ("lump", 0.0),
        ("blind", 0.0),
        ("system", 0.0),
        ("blocked", 0.0),
    ]
    assert bus.settled() == []


def test_a_stopped_feeder_is_told_and_suppresses_the_lump_alarm_until_it_runs(bus: Bus) -> None:
    bus.orders.write(REGION, "feeder_runs", False)
    stopped = {"signal": "feeder-stopped", "valid_s": 9.0, "class": "lump"}
    assert bus.settled() == [
        ("feed", {"signal": "feeder", "valid_s": 9.0, "runs": False}),
        ("suppress", stopped),
    ]
    bus.orders.write(REGION, "feeder_runs", True)
    assert bus.settled() == [
        ("feed", {"signal": "feeder", "valid_s": 9.0, "runs": True}),
        ("suppress", {**stopped, "valid_s": 0.0}),
    ]
    assert bus.orders.read(REGION, "feeder_runs")


def test_what_the_bus_refuses_is_tried_again_after_a_second(bus: Bus) -> None:
    bus.refuses = "nobody answers"
    bus.orders.write(REGION, "feeder_runs", False)
    assert bus.settled() == []
    bus.refuses = None
    assert bus.settled() == []
    bus.now += 1.1
    assert len(bus.settled()) == 2
