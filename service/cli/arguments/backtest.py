"""Arguments of `lumpwatch backtest`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.arguments.workers import add_resuming, add_workers
from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness, add_span


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "backtest",
        late("backtest", "backtest"),
        "Run one or several configurations over labelled videos, in parallel, and compare them: lumps "
        "announced, warning time before the lip and false alarms an hour at every alarm threshold, and the "
        "threshold for a wanted rate of false alarms.",
        "lumpwatch backtest site.yaml other.yaml --videos a.mp4 b.mp4 --labels a.txt b.txt --out out",
    )
    parser.add_argument("config", type=Path, nargs="+", metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--videos",
        type=Path,
        nargs="+",
        required=True,
        metavar="VIDEO",
        help="videos, folders of videos, or folders of images",
    )
    parser.add_argument(
        "--labels",
        type=Path,
        nargs="+",
        metavar="LABELS",
        help="one label file a video, in their order, MOTChallenge text; an empty one says that no lump comes "
        "(default: beside each video, clip.txt for clip.mp4, or gt.txt)",
    )
    parser.add_argument(
        "--unlabelled-is-empty", action="store_true", help="no lump comes in a video without labels beside it"
    )
    parser.add_argument("--camera", metavar="ID", help="camera, where a configuration has several")
    parser.add_argument("--roi", metavar="ID", help="ROI, where the camera has several")
    parser.add_argument(
        "--fall-model",
        default="fall",
        metavar="NAME",
        help="a lump is at the lip when its labels first name this motion model, or else at its last label "
        "(default fall)",
    )
    add_span(
        parser,
        "least-warning",
        "how long before the lip a lump must be announced",
        default="1s",
        older="least-warning-s",
    )
    add_span(
        parser,
        "tolerance",
        "an alarm is not false this close to a labelled lump",
        default="500ms",
        older="tolerance-s",
    )
    parser.add_argument(
        "--false-alarms-per-hour",
        type=float,
        default=0.1,
        metavar="RATE",
        help="how many false alarms are wanted at most (default 0.1)",
    )
    add_workers(parser)
    add_resuming(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for backtest.json, lumps.csv and backtest.png"
    )
    add_json(parser, "print what backtest.json holds")
    add_loudness(parser)
