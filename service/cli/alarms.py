"""`lumpwatch alarms`: follow the alarm topic, or acknowledge an alarm."""

from __future__ import annotations

import argparse
import sys
import threading
from pathlib import Path

from pydantic import ValidationError

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.cli.common import Commands, add_command, stop_on_signals
from lumpwatch.service.config import BusConfig, load_config
from lumpwatch.service.core import AlarmClass, AlarmState
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.protocol import AlarmEvent, StateMessage


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "alarms",
        alarms,
        "Follow the alarms of a running daemon: past ones that it still holds, the present states, and "
        "whatever comes.",
        "lumpwatch alarms site.yaml --json",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--json", action="store_true", help="print the records as they are, one a line")
    parser.add_argument("--count", type=int, metavar="N", help="end after N alarm records")
    parser.add_argument(
        "--ack", metavar="CAMERA/ROI", help="acknowledge the alarm of this ROI instead of following"
    )
    parser.add_argument("--actor", default="", metavar="NAME", help="who acknowledges (with --ack)")


def as_client(bus: BusConfig) -> BusConfig:
    """How an outsider on this host joins the daemon's bus."""
    return bus.model_copy(update={"mode": "client", "connect": bus.hub, "listen": ()})


def alarms(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.ack and ("/" not in arguments.ack or not arguments.actor):
        raise ConfigError("--ack takes CAMERA/ROI and needs --actor NAME")
    config = load_config(arguments.config)
    keys = Keys(config.site)
    stop = stop_on_signals()
    with open_client(as_client(config.bus), stop, wait=False) as bus:
        if arguments.ack:
            camera, _, roi = arguments.ack.partition("/")
            answer = ask_one(bus, keys.command(camera, roi, "ack"), {"actor": arguments.actor}, arguments.ack)
            _print(answer.decode())
            return 0
        done = threading.Event()
        seen = 0
        lock = threading.Lock()

        def on_alarm(key: str, payload: bytes) -> None:
            nonlocal seen
            with lock:
                if done.is_set():
                    return
                try:
                    _print(payload.decode(errors="replace") if arguments.json else describe_alarm(payload))
                except BrokenPipeError:  # who read has gone
                    done.set()
                    return
                seen += 1
                if arguments.count is not None and seen >= arguments.count:
                    done.set()

        if not arguments.json:
            for reply in bus.ask(keys.states()):
                if reply.payload is not None:
                    _print(describe_state(reply.payload))
        bus.subscribe_alarms(
            keys.alarms(), on_alarm, lambda n: _print(f"{n} alarm records were missed", sys.stderr)
        )
        while not done.is_set() and not stop.wait(0.1):
            pass
    return 0


def ask_one(bus: Bus, key: str, parameters: dict[str, str], target: str, timeout_s: float = 2.0) -> bytes:
    """The only answer to a query; raises LumpwatchError where there is none, or it is an error."""
    replies = bus.ask(key, parameters, timeout_s=timeout_s)
    if not replies:
        raise LumpwatchError(
            f"nobody answers for {target}: is the daemon running, the name right, and this client allowed to?"
        )
    reply = replies[0]
    if reply.payload is None:
        raise LumpwatchError(f"{target}: {reply.error}")
    return reply.payload


def describe_alarm(payload: bytes) -> str:
    """One line for a person."""
    try:
        event = AlarmEvent.model_validate_json(payload)
    except ValidationError:
        return f"a malformed alarm record of {len(payload)} bytes"
    data = event.data
    where = ""
    if box := next((found for found in data.objects if found.counts), None):
        where = f", box {box.w:.0f} x {box.h:.0f} px at ({box.x:.0f}, {box.y:.0f}), {box.model}"
    actor = f" by {data.actor}" if data.actor else ""
    of = "" if data.alarm_class is AlarmClass.LUMP else f"{data.alarm_class.value} "
    what = f"{'TEST ' if data.test else ''}{of}{data.change.value}"
    why = f" ({data.reason})" if data.reason else ""
    left = "" if data.left_s is None else f", {data.left_s:.1f} s to the lip"
    return (
        f"{event.time:%Y-%m-%d %H:%M:%S} {data.camera}/{data.roi}: {what}{actor}{why}, now {data.state}, "
        f"existence {data.existence:.2f}, frame {data.frame}{where}{left}"
    )


def describe_state(payload: bytes) -> str:
    """One line for a person."""
    try:
        state = StateMessage.model_validate_json(payload)
    except ValidationError:
        return f"a malformed state of {len(payload)} bytes"
    reason = f" ({state.reason.value})" if state.reason else ""
    others = "".join(
        f", {alarm_class} alarm {stands}"
        for alarm_class, stands in state.alarms.items()
        if alarm_class is not AlarmClass.LUMP and stands != AlarmState.NORMAL
    )
    return (
        f"{state.camera}/{state.roi}: {state.state.value}{reason}, "
        f"alarm {state.alarm}{others}, existence {state.existence:.2f}"
    )


def _print(line: str, stream: object = None) -> None:
    out = sys.stdout if stream is None else sys.stderr
    out.write(line + "\n")
    out.flush()
