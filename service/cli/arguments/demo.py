"""Arguments of `lumpwatch demo`."""

from __future__ import annotations

import argparse

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, duration


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "demo",
        late("demo", "demo"),
        "Run the daemon on a simulated crusher feed and follow it as a bus client would.",
        "lumpwatch demo --for 60s",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--for", dest="for_s", type=duration, default=0.0, metavar="TIME",
        help="end by itself after this long, such as 60s (default: Ctrl-C ends it)",
    )  # fmt: skip
    length.add_argument("--seconds", dest="for_s", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--seed", type=int, help="seed of the simulated feed")
