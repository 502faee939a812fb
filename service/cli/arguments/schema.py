"""Arguments of `lumpwatch schema`."""

from __future__ import annotations

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command

MESSAGE_NAMES = (
    "alarm",
    "state",
    "heartbeat",
    "level",
    "replay",
    "shadow",
    "frame",
    "act-reply",
    "verdict-reply",
    "proof-result",
    "blend",
    "blend-reply",
    "evidence",
    "ack",
    "reset",
    "shelve",
    "unshelve",
    "service",
    "suppress",
    "feed",
    "verdict",
    "evidence-request",
    "prior",
    "proof",
)
"""As `MESSAGES` of the protocol calls them."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "schema",
        late("schema", "schema"),
        "Print the JSON Schema of the configuration or of a message, or the AsyncAPI document of the bus.",
        "lumpwatch schema alarm > alarm.schema.json",
    )
    parser.add_argument(
        "of",
        nargs="?",
        default="config",
        choices=("config", "asyncapi", *MESSAGE_NAMES),
        help="what to describe (default: the configuration)",
    )
