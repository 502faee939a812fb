"""Arguments of `lumpwatch gateway`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "gateway",
        late("gateway", "gateway"),
        "Serve the plant's control system by Modbus TCP, OPC UA and MQTT until told to stop (Ctrl-C or SIGTERM), or "
        "print the map of what it serves.",
        "lumpwatch gateway site.yaml --map --csv > map.csv",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--map", action="store_true", help="print the register map and end")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="the map as CSV")
    form.add_argument("--json", action="store_true", help="the map as JSON")
    add_loudness(parser)
