"""Arguments of `lumpwatch reference`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "reference",
        late("reference", "reference"),
        "Learn from recordings of a fit picture what a camera shows, and from where on its picture is not fit "
        "to judge (blurred, dusty, hidden, moved, frozen, dark, glare). A running daemon takes it.",
        "lumpwatch reference site.yaml day.mp4 rain.mp4 --night night.mp4 --camera crusher-1",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "videos",
        type=Path,
        nargs="*",
        metavar="VIDEO",
        help="recordings by day, in all weathers that are fit",
    )
    parser.add_argument("--camera", metavar="ID", help="camera of the reference (default: the only one)")
    parser.add_argument(
        "--night", type=Path, nargs="+", default=[], metavar="VIDEO", help="the same by night"
    )
    parser.add_argument(
        "--false-share",
        type=float,
        default=1e-3,
        metavar="SHARE",
        help="share of the time for which footage like this may be taken for unfit (default 0.001)",
    )
    parser.add_argument("--use", type=int, metavar="N", help="learn nothing, go back to stored version N")
    add_json(parser, "print version and thresholds as JSON")
    add_loudness(parser)
