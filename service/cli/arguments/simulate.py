"""Arguments of `lumpwatch simulate`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness, add_span


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "simulate",
        late("simulate", "simulate"),
        "Render the simulated crusher feed: video.mp4, its labels gt.txt, spec.json, and site.yaml, which watches it.",
        'lumpwatch simulate out/feed --for 60s --seed 3 --set "lumps_per_minute=8&dust=0.5"',
    )
    parser.add_argument("out", type=Path, metavar="OUT_DIR", help="folder for the files")
    add_span(parser, "for", "length", default="60s", older="seconds")
    parser.add_argument("--seed", type=int, help="seed of everything random (default 0)")
    parser.add_argument(
        "--set", default="", metavar="QUERY", help="anything else of the feed, key=value joined by &"
    )
    add_json(parser, "print the files as JSON")
    add_loudness(parser)
