"""`lumpwatch schema`: the JSON Schemas of configuration and messages."""

from __future__ import annotations

import argparse
import json
import sys

from service.cli.common import Commands, add_command
from service.config import schema as config_schema
from service.messages import AlarmEvent, Heartbeat, Level, Record, StateLine, StateMessage
from service.shadow.record import ShadowState

_MESSAGES: dict[str, type[Record]] = {
    "alarm": AlarmEvent,
    "state": StateMessage,
    "heartbeat": Heartbeat,
    "level": Level,
    "shadow": ShadowState,
    "replay": StateLine,
}


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "schema",
        schema,
        "Print the JSON Schema of the configuration or of a message.",
        "lumpwatch schema alarm > alarm.schema.json",
    )
    parser.add_argument(
        "of",
        nargs="?",
        default="config",
        choices=("config", *_MESSAGES),
        help="what to describe (default: the configuration)",
    )


def schema(arguments: argparse.Namespace) -> int:
    """Run the command."""
    sys.stdout.write(text(arguments.of) + "\n")
    return 0


def text(of: str) -> str:
    """One schema as JSON text."""
    if of == "config":
        return config_schema()
    return json.dumps(_MESSAGES[of].model_json_schema(mode="serialization"), indent=2, sort_keys=True)
