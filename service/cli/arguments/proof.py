"""Arguments of `lumpwatch proof`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_actor, add_command


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "proof",
        late("proof", "proof"),
        "Test a running daemon: a synthetic lump is blended into the real frames and must come out as an "
        "alarm on the test key. Exit code 1 where any test does not pass.",
        "lumpwatch proof site.yaml --camera crusher-1 --roi apron",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="this camera only")
    parser.add_argument("--roi", metavar="ID", help="this ROI of the camera only (with --camera)")
    add_actor(parser, "who asks; it is recorded", required=False)
    parser.add_argument("--json", action="store_true", help="print the results as they are, one a line")
