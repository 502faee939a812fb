"""Arguments of `lumpwatch console`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "console",
        late("console", "console"),
        "Serve the operator's console, a web page, until it is told to stop (Ctrl-C or SIGTERM).",
        "lumpwatch console site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    add_loudness(parser)
