"""Arguments of `lumpwatch train`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.arguments.learning import add_judging
from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "train",
        late("train", "train"),
        "Learn motion models, their switching, sizes and likelihood of one ROI from labelled videos, and "
        "store them as a new prior with a report beside it. Where it stands up to its cross-validation, a running "
        "daemon takes it without a restart. "
        "With --suggest: propose labels for a video instead.",
        "lumpwatch train site.yaml clip.mp4 gt.txt --camera crusher-1 --roi apron\n"
        "  lumpwatch train site.yaml a.mp4 a.txt b.mp4 b.txt --camera crusher-1 --roi apron --without-lumps c.mp4\n"
        "  lumpwatch train site.yaml new.mp4 --camera crusher-1 --roi apron --suggest new.txt\n"
        "  lumpwatch train site.yaml new.mp4 new.txt --camera crusher-1 --roi apron --accept 1,2,5",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("video", type=Path, metavar="VIDEO", help="video file or folder of images")
    parser.add_argument(
        "labels",
        type=Path,
        nargs="?",
        metavar="LABELS",
        help="its labels, MOTChallenge text: frame,id,x,y,w,h,… (left out with --suggest)",
    )
    parser.add_argument(
        "more", type=Path, nargs="*", metavar="VIDEO LABELS", help="more videos, each with its labels"
    )
    parser.add_argument("--camera", metavar="ID", help="camera of the prior (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the prior (default: the only one)")
    parser.add_argument(
        "--without-lumps",
        type=Path,
        nargs="+",
        action="extend",
        default=[],
        metavar="VIDEO",
        help="videos in which no lump comes: what looks like one there is learned as background",
    )
    parser.add_argument(
        "--shadow", action="store_true", help="run it in shadow beside the prior in use, which stays"
    )
    parser.add_argument(
        "--use-anyway",
        action="store_true",
        help="use it also where the cross-validation finds none of the lumps that were held out",
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw what was learned")
    add_judging(parser)
    parser.add_argument(
        "--suggest",
        type=Path,
        metavar="OUT",
        help="do not train: let the present filter propose labels for VIDEO, as a label file and a page of pictures",
    )
    parser.add_argument(
        "--accept",
        metavar="IDS",
        help="before training, turn these proposals of LABELS into labels: ids as in 1,3,4, or all",
    )
    add_json(parser, "print what was learned and how it was judged as JSON; with --suggest what was proposed")
    add_loudness(parser)
