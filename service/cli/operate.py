"""`lumpwatch ack`, `reset`, `shelve`, `unshelve`, `service`: what an operator does to a running daemon's alarms."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one
from lumpwatch.service.cli.common import Commands, add_command, camera_of, roi_of
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmClass, seconds_of
from lumpwatch.service.errors import ConfigError

_WHERE = "--camera crusher-1 --roi apron --actor anna"


def add(commands: Commands) -> None:
    """Add the commands."""
    _with_target(
        add_command(
            commands,
            "ack",
            ack,
            "Acknowledge an alarm of a running daemon.",
            f"lumpwatch ack site.yaml {_WHERE}",
        )
    )
    _with_target(
        add_command(
            commands,
            "reset",
            reset,
            "Reset an alarm that is over and acknowledged, but latched.",
            f"lumpwatch reset site.yaml {_WHERE}",
        )
    )
    shelving = _with_target(
        add_command(
            commands,
            "shelve",
            shelve,
            "Keep an alarm from being announced for a limited time; the condition is judged and recorded on.",
            f'lumpwatch shelve site.yaml {_WHERE} --for 30m --reason "dust from the repair"',
        )
    )
    shelving.add_argument(
        "--for", required=True, dest="span", metavar="TIME", help="how long: 90s, 30m, 1h30m"
    )
    shelving.add_argument("--reason", required=True, metavar="TEXT", help="why")
    _with_target(
        add_command(
            commands,
            "unshelve",
            unshelve,
            "End the shelving of an alarm.",
            f"lumpwatch unshelve site.yaml {_WHERE}",
        )
    )
    serving = add_command(
        commands,
        "service",
        service,
        "Take an alarm out of service, or put it back in; it stays out until then.",
        f'lumpwatch service site.yaml out {_WHERE} --reason "camera is being moved"',
    )
    _with_target(serving)
    serving.add_argument("state", choices=("out", "in"), help="out of service, or in service again")
    serving.add_argument("--reason", default="", metavar="TEXT", help="why (needed for out)")


def _with_target(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", required=True, metavar="ID", help="camera of the alarm")
    parser.add_argument("--roi", required=True, metavar="ID", help="ROI of the alarm")
    parser.add_argument("--actor", required=True, metavar="NAME", help="who does it; it is recorded")
    parser.add_argument(
        "--class",
        dest="alarm_class",
        choices=tuple(one.value for one in AlarmClass),
        default=AlarmClass.LUMP.value,
        help="lump (default), blind: the ROI cannot judge, or system: it judges late, or a proof test failed",
    )
    return parser


def ack(arguments: argparse.Namespace) -> int:
    """Run the command."""
    return _ask(arguments, "ack", {})


def reset(arguments: argparse.Namespace) -> int:
    """Run the command."""
    return _ask(arguments, "reset", {})


def shelve(arguments: argparse.Namespace) -> int:
    """Run the command."""
    span_s = seconds_of(arguments.span)
    return _ask(arguments, "shelve", {"reason": arguments.reason, "for_s": f"{span_s:g}"})


def unshelve(arguments: argparse.Namespace) -> int:
    """Run the command."""
    return _ask(arguments, "unshelve", {})


def service(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.state == "in":
        return _ask(arguments, "service", {"state": "in"})
    if not arguments.reason:
        raise ConfigError("service out needs --reason TEXT")
    return _ask(arguments, "service", {"state": "out", "reason": arguments.reason})


def _ask(arguments: argparse.Namespace, what: str, parameters: dict[str, str]) -> int:
    config = load_config(arguments.config)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    keys = Keys(config.site)
    key = {
        "ack": keys.ack,
        "reset": keys.reset,
        "shelve": keys.shelve,
        "unshelve": keys.unshelve,
        "service": keys.service,
    }[what]
    asked = parameters | {"actor": arguments.actor, "class": arguments.alarm_class}
    with open_client(as_client(config.bus), wait=False) as bus:
        answer = ask_one(bus, key(camera.id, roi.id), asked, f"{camera.id}/{roi.id}")
    told = json.loads(answer)
    changes = ", ".join(told["changes"]) or "nothing to do"
    print(f"{camera.id}/{roi.id} {told['class']}: {changes}, now {told['alarm']}")  # noqa: T201
    return 0
