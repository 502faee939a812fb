"""Arguments of `lumpwatch bench`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_span


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "bench",
        late("bench", "bench"),
        "Measure what each camera takes of this machine, and how many such cameras it carries.",
        "lumpwatch bench site.yaml --for 20s",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="this camera only")
    parser.add_argument(
        "--video",
        type=Path,
        metavar="FILE",
        help="measure on this file, as the camera sends it (default: a clip is taken of the source)",
    )
    add_span(parser, "for", "length that is measured", default="10s", older="seconds")
    add_json(parser)
