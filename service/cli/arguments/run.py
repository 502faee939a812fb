"""Arguments of `lumpwatch run`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "run",
        late("run", "run"),
        "Run the daemon until it is told to stop (Ctrl-C or SIGTERM).",
        "lumpwatch run site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--camera", action="append", default=[], metavar="ID", help="only this camera (may be repeated)"
    )
    parser.add_argument(
        "--only",
        choices=("camera", "monitor"),
        help="only the processes that read cameras, or only those that filter; the others run elsewhere",
    )
    add_loudness(parser)
