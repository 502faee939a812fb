"""`lumpwatch ack`, `shelve`, …: what an operator does to a running daemon's alarms.

One subcommand for each row of the command table that has a `cli`; its options are the fields of the request.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import Commands, add_actor, add_command, add_json, tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmClass, AlarmRequestError, seconds_of
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import COMMANDS, ActReply, Cli, Command, read_request

_WHERE = "--camera crusher-1 --roi apron --by anna"
_SPAN = "_s"
"""What the names of fields with seconds end with; on the command line they are times like 30m, without it."""


def add(commands: Commands) -> None:
    """Add the commands."""
    for row in COMMANDS.values():
        if row.cli is not None:
            _add(commands, row, row.cli)


def _add(commands: Commands, row: Command, cli: Cli) -> None:
    example = f"lumpwatch {row.name} {cli.verb}site.yaml {cli.example.format(where=_WHERE)}"
    parser = add_command(commands, row.name, partial(_ask, row), cli.text, example)
    for name, field in _own(row).items():
        if _is_verb(field):
            parser.add_argument(name, choices=get_args(field.annotation), help=_text(name, field))
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="camera of the alarm (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the alarm (default: the only one)")
    add_actor(parser, "who does it; it is recorded", required=True)
    parser.add_argument(
        "--class",
        dest="alarm_class",
        choices=tuple(alarm_class.value for alarm_class in AlarmClass),
        default=AlarmClass.LUMP.value,
        help="lump (default), blind: the ROI cannot judge, or system: it judges late, or a proof test failed",
    )
    for name, field in _own(row).items():
        if not _is_verb(field):
            _add_field(parser, name, field)
    add_json(parser, "print what became of the alarm as JSON")


def _own(row: Command) -> dict[str, FieldInfo]:
    """The fields that not every command has."""
    shared = ("alarm_class", "actor")
    return {name: field for name, field in row.request.model_fields.items() if name not in shared}


def _is_verb(field: FieldInfo) -> bool:
    """Whether it stands as a word before CONFIG, as the verbs of other commands do."""
    return get_origin(field.annotation) is Literal


def _text(name: str, field: FieldInfo) -> str:
    text = (field.description or name).rstrip(".").replace("`", "")
    return text[0].lower() + text[1:]


def _add_field(parser: argparse.ArgumentParser, name: str, field: FieldInfo) -> None:
    text = _text(name, field)
    if name.endswith(_SPAN):
        option, text = name.removesuffix(_SPAN), f"{text}: 90s, 30m, 1h30m"
        parser.add_argument(f"--{option}", required=field.is_required(), dest=name, metavar="TIME", help=text)
    else:
        parser.add_argument(f"--{name}", required=field.is_required(), metavar="TEXT", help=text)


def _ask(row: Command, arguments: argparse.Namespace) -> int:
    """Run a command."""
    given: dict[str, object] = {"actor": arguments.actor, "class": arguments.alarm_class}
    for name in _own(row):
        value = getattr(arguments, name)
        if value is not None:
            given[name] = seconds_of(value) if name.endswith(_SPAN) else value
    try:
        request = read_request(row.request, given)
    except AlarmRequestError as error:
        raise ConfigError(f"{row.name}: {error}") from error
    config = load_config(arguments.config)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    target, key = f"{camera.id}/{roi.id}", Keys(config.site).command(camera.id, roi.id, row.name)
    parameters = request.model_dump(mode="json", by_alias=True, exclude_none=True)
    with open_client(as_client(config.bus), wait=False) as bus:
        answer = ask_one(bus, key, {name: str(value) for name, value in parameters.items()}, target)
    reply = read_answer(ActReply, answer, target)
    if arguments.json:
        told = reply.model_dump(mode="json", by_alias=True)
        tell_json({"command": row.name, "camera": camera.id, "roi": roi.id, **told})
        return 0
    changes = ", ".join(reply.changes) or "nothing to do"
    print(f"{target} {reply.alarm_class}: {changes}, now {reply.alarm}")  # noqa: T201
    return 0
