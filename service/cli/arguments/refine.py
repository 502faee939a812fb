"""Arguments of `lumpwatch refine`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.arguments.learning import add_judging
from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "refine",
        late("refine", "refine_command"),
        "Train a ROI anew on confirmed clips together with the footage that was kept of earlier trainings "
        "(learning.footage_mb), report on it as train does, and run the result in shadow beside the prior in use.",
        "lumpwatch refine site.yaml confirmed/*.mp4 --camera crusher-1 --roi apron",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "videos",
        type=Path,
        nargs="+",
        metavar="VIDEO",
        help="video file or folder of images, its labels beside it: clip.txt or gt.txt",
    )
    parser.add_argument("--labels", type=Path, nargs="+", metavar="FILE", help="labels, one file a video")
    parser.add_argument(
        "--unlabelled-is-empty",
        action="store_true",
        help="a video without labels shows no lump, such as a confirmed false alarm",
    )
    parser.add_argument("--camera", metavar="ID", help="camera of the prior (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the prior (default: the only one)")
    add_judging(parser)
    add_json(parser, "print what was learned and how it was judged as JSON")
    add_loudness(parser)
