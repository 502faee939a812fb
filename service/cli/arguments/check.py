"""Arguments of `lumpwatch check`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, picture_size


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "check",
        late("check", "check"),
        "Check a configuration, its calibrations and the priors it uses, without starting anything; on request also "
        "what the cameras send.",
        "lumpwatch check site.yaml --connect\n  lumpwatch check site.yaml --picture crusher-1.png --out grid.png",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--size",
        type=picture_size,
        metavar="WxH",
        help="size of the pictures, such as 1920x1080 (default: that of --picture, what --connect finds, or 1920x1080)",
    )
    parser.add_argument(
        "--camera", metavar="ID", help="of this camera only; with --picture whose picture it is"
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="FILE",
        help="still of a camera: draw its polygons and calibrations on it (lumpwatch snapshot saves one)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="where the drawn picture goes (default: FILE-checked.png beside it)",
    )
    parser.add_argument(
        "--connect",
        action="store_true",
        help="open each source: size, rate, codec, key frames, clock; with --out a still of one camera goes there",
    )
    parser.add_argument("--json", action="store_true", help="print what was found as JSON")
