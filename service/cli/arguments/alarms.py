"""Arguments of `lumpwatch alarms`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_actor, add_command

SILENT = 3
"""Exit code of `--exit-on-silence`."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "alarms",
        late("alarms", "alarms"),
        "Follow the alarms of a running daemon: past ones that it still holds, the present states, and "
        "whatever comes. Says SILENT when nothing valid is heard of a camera, and when it is heard again. On a "
        "terminal LUMP is red, BLIND and SILENT are violet, unless NO_COLOR is set.",
        "lumpwatch alarms site.yaml --exit-on-silence || page-someone",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--json", action="store_true", help="print the records as they are, one a line")
    parser.add_argument("--camera", metavar="ID", help="of this camera only")
    parser.add_argument("--count", type=int, metavar="N", help="end after N alarm records")
    parser.add_argument(
        "--exit-on-silence",
        action="store_true",
        help=f"end with code {SILENT} as soon as a camera is silent (for scripts)",
    )
    parser.add_argument(
        "--ack", metavar="CAMERA/ROI", help="acknowledge the alarm of this ROI instead of following"
    )
    add_actor(parser, "who acknowledges (with --ack)", required=False)
