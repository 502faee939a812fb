"""Arguments of `lumpwatch replay`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "replay",
        late("replay", "replay"),
        "Run a camera's pipeline on a video file or a folder of images, as fast as it goes.",
        "lumpwatch replay site.yaml clip.mp4 --camera crusher-1 --out out --plot --overlay",
    )
    parser.add_argument(
        "config",
        type=Path,
        nargs="?",
        metavar="CONFIG",
        help="configuration file (YAML); not with --evidence",
    )
    parser.add_argument(
        "video",
        type=Path,
        nargs="?",
        metavar="VIDEO",
        help="video file or folder of images; not with --evidence",
    )
    parser.add_argument(
        "--camera", metavar="ID", help="camera whose ROIs look at the file (default: the only one)"
    )
    parser.add_argument(
        "--evidence",
        type=Path,
        metavar="DIR",
        help="replay the evidence of an alarm instead, from the filter state that it holds, and compare the "
        "decisions with those made live; exit code 1 where they differ",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder for the results")
    parser.add_argument("--plot", action="store_true", help="draw the existence curve of each ROI (PNG)")
    parser.add_argument(
        "--overlay", action="store_true", help="write a video with ROI, particles, estimate and existence"
    )
    parser.add_argument(
        "--shadow",
        type=int,
        metavar="VERSION",
        help="run that version of the prior in shadow; how it differs is written to shadow.json",
    )
    add_json(parser, "print what summary.json holds")
    add_loudness(parser)
