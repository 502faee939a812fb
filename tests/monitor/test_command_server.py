"""Every row of the command table is done by something, and what is asked wrongly is counted under its name."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace

import pytest

from lumpwatch.service.bus import Keys, Role
from lumpwatch.service.config import AlarmConfig
from lumpwatch.service.core import (
    Alarm,
    AlarmAction,
    AlarmChange,
    AlarmClass,
    AlarmRequestError,
    RoiResult,
)
from lumpwatch.service.monitor.command_server import CommandServer, Do
from lumpwatch.service.protocol import COMMANDS, Command, Lane, Request
from tests.monitor.fakes import FakeBus, FakeLink
from tests.protocol.test_messages import STARTING

KEYS = Keys("pit")
RULES = AlarmConfig()


class OneAlarm:
    """The alarms of a ROI, of which one waits."""

    def __init__(self) -> None:
        self.alarms = dict.fromkeys(AlarmClass, Alarm()) | {AlarmClass.LUMP: Alarm(active=True, waits=True)}

    def apply(self, roi: str, alarm_class: AlarmClass, action: AlarmAction) -> tuple[RoiResult, int]:
        self.alarms[alarm_class], made = action(self.alarms[alarm_class], RULES, 10.0)
        alarm = self.alarms[alarm_class]
        changes = tuple(AlarmChange(alarm_class, one, alarm, "high") for one in made)
        return replace(STARTING, roi=roi, alarms=dict(self.alarms), changes=changes), 7


def echo(roi: str, asked: Request) -> bytes:
    return json.dumps([roi, asked.model_dump(mode="json", exclude_none=True)]).encode()


OTHERS: dict[str, Do] = {name: echo for name, row in COMMANDS.items() if row.action is None}


class Served:
    """A command server on a fake bus."""

    def __init__(self, commands: dict[str, Command] = COMMANDS) -> None:
        self.refused: Counter[tuple[str, str]] = Counter()
        server = CommandServer(
            alarms=OneAlarm(),
            others=OTHERS,
            refused=lambda roi, name: self.refused.update([(roi, name)]),
            commands=commands,
        )
        self.bus = FakeBus(FakeLink())
        server.serve(self.bus, KEYS, "cam", ("apron", "chute"))

    def ask(self, name: str, roi: str = "apron", **parameters: str) -> object:
        return self.bus.ask(KEYS.command("cam", roi, name), **parameters)


def test_each_region_is_one_queryable_with_all_commands() -> None:
    served = Served()
    assert served.bus.queryables == [KEYS.region("cam", "apron"), KEYS.region("cam", "chute")]
    assert set(served.bus.services) == {
        KEYS.command("cam", roi, name) for roi in ("apron", "chute") for name in COMMANDS
    }


def test_no_alarm_command_waits_for_a_disk_or_a_test() -> None:
    services = Served().bus.services
    lanes = {name: services[KEYS.command("cam", "apron", name)] for name in COMMANDS}
    assert {lanes[name].lane for name, row in COMMANDS.items() if row.action is not None} == {Lane.ALARMS}
    assert {lanes[name].lane for name in ("verdict", "evidence", "prior")} == {Lane.STORE}
    assert [name for name, one in lanes.items() if not one.waits] == ["proof"]


def test_an_alarm_command_is_done_and_answered() -> None:
    assert Served().ask("ack", actor="Ada") == {
        "class": "lump",
        "changes": ["acknowledged"],
        "alarm": "ACKNOWLEDGED",
        "active": True,
        "sequence": 7,
        "acknowledged": True,
    }


@pytest.mark.parametrize("name", OTHERS)
def test_other_commands_get_their_request(name: str) -> None:
    example = COMMANDS[name].example.model_dump(mode="json", exclude_none=True)
    asked = Served().ask(name, "chute", **{key: str(value) for key, value in example.items()})
    assert asked == ["chute", example]


@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_asked_wrongly_is_counted_under_the_name_of_the_command(name: str) -> None:
    served = Served()
    with pytest.raises(AlarmRequestError, match=r"^nonsense: "):
        served.ask(name, "chute", nonsense="1", **_needed(name))
    assert served.refused == {("chute", name): 1}


def _needed(name: str) -> dict[str, str]:
    return {
        key: str(value)
        for key, value in COMMANDS[name]
        .example.model_dump(mode="json", exclude_none=True, by_alias=True)
        .items()
    }


def test_a_command_that_nothing_does_is_noticed_at_once() -> None:
    lost = Command("lost", "Does nothing.", Role.OPERATOR, COMMANDS["prior"].example)
    with pytest.raises(KeyError, match="lost"):
        Served(COMMANDS | {"lost": lost})


def test_a_put_of_another_camera_s_region_is_left_alone() -> None:
    served = Served()
    put = served.bus.subscriptions[KEYS.commands("suppress", "cam")]
    put(KEYS.command("cam", "elsewhere", "suppress"), b'{"signal": "feeder", "valid_s": 9}')
    put(KEYS.command("cam", "apron", "suppress"), b"nonsense")
    assert served.refused == {("apron", "suppress"): 1}
