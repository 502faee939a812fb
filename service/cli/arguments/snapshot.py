"""Arguments of `lumpwatch snapshot` and `lumpwatch record`."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness, add_span


def add(commands: Commands) -> None:
    """Add the commands."""
    parser = add_command(
        commands,
        "snapshot",
        late("snapshot", "snapshot_command"),
        "Save a still of a camera, to draw polygon and calibration on.",
        "lumpwatch snapshot site.yaml --out crusher-1.png",
    )
    _where(parser, "picture to write (.png, .jpg)")
    parser = add_command(
        commands,
        "record",
        late("snapshot", "record_command"),
        "Record a clip of a camera as it comes, to label, train on and replay.",
        "lumpwatch record site.yaml --for 2m --out clip.mp4",
    )
    _where(parser, "clip to write (.mp4, .mkv)")
    add_span(parser, "for", "length, such as 90s or 2m", default="60s")
    add_loudness(parser)


def _where(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="camera (default: the only one)")
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help=text)
    add_json(parser, "print what was written as JSON")
