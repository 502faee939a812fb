"""`lumpwatch schema`: the JSON Schemas of configuration and messages."""

from __future__ import annotations

import argparse
import sys

from lumpwatch.service.cli.options import Commands, add_command
from lumpwatch.service.config import config_schema
from lumpwatch.service.protocol import MESSAGES, asyncapi_text, message_schema


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "schema",
        schema,
        "Print the JSON Schema of the configuration or of a message, or the AsyncAPI document of the bus.",
        "lumpwatch schema alarm > alarm.schema.json",
    )
    parser.add_argument(
        "of",
        nargs="?",
        default="config",
        choices=("config", "asyncapi", *MESSAGES),
        help="what to describe (default: the configuration)",
    )


def schema(arguments: argparse.Namespace) -> int:
    """Run the command."""
    sys.stdout.write(text(arguments.of).rstrip("\n") + "\n")
    return 0


def text(of: str) -> str:
    """One schema as JSON text; the AsyncAPI document as YAML."""
    if of == "config":
        return config_schema()
    return asyncapi_text() if of == "asyncapi" else message_schema(of)
