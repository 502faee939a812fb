"""Arguments of `lumpwatch events`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "events",
        late("events", "events"),
        "Print the event log: every change of every alarm and what operators did, oldest first.",
        "lumpwatch events site.yaml --since 12h --format csv > shift.csv",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--since",
        metavar="TIME",
        help="only later ones: 2024-05-17T06:00 (local time unless it says otherwise), or 12h ago as 12h",
    )
    parser.add_argument("--camera", metavar="ID", help="of this camera only")
    parser.add_argument(
        "--format", choices=("table", "jsonl", "csv"), default="table", help="how to print (default: table)"
    )
    parser.add_argument(
        "--json", action="store_const", const="jsonl", dest="format", help="one record a line: --format jsonl"
    )
