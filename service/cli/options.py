"""What commands need of the command line alone: adding one, options that several have. Nothing large is imported here.

`lumpwatch health` runs every few seconds on small machines, so it takes no more than this.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]
else:
    Commands = object

log = logging.getLogger(__name__)

Command = Callable[[argparse.Namespace], int]


def add_command(
    commands: Commands, name: str, command: Command, help_text: str, example: str
) -> argparse.ArgumentParser:
    """Add one command with its help and an example."""
    added = commands.add_parser(
        name,
        help=help_text,
        description=help_text,
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    added.set_defaults(command=command)
    return added


def add_json(parser: argparse.ArgumentParser, text: str = "print what was found as JSON") -> None:
    """Add `--json`: the facts for another program, on standard output and nothing else there."""
    parser.add_argument("--json", action="store_true", help=text)


def tell_json(content: object) -> None:
    """Print it on standard output, for another program; what JSON has no number for is an error, never printed."""
    sys.stdout.write(json.dumps(content, indent=2, allow_nan=False) + "\n")


def add_loudness(parser: argparse.ArgumentParser) -> None:
    """Add `--quiet` and `--verbose`, which stand for levels of `LUMPWATCH_LOG_LEVEL`."""
    group = parser.add_mutually_exclusive_group()
    for short, name, level, text in (
        ("-q", "--quiet", "warning", "warnings and errors alone on standard error: no progress, no log"),
        ("-v", "--verbose", "debug", "what is being done, on standard error, in place of progress"),
    ):
        group.add_argument(short, name, action="store_const", const=level, dest="log_level", help=text)


def duration(text: str) -> float:
    """Seconds of a span with units, for argparse: 90s, 30m, 1h30m. A number alone is refused."""
    from lumpwatch.service.core import seconds_of
    from lumpwatch.service.errors import ConfigError

    try:
        return seconds_of(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def timeout(text: str) -> float:
    """Seconds of a span; a number alone still counts as seconds, with a warning."""
    # Version 0.1 took seconds here, and scripts that watch a plant must not fail by an upgrade.
    try:
        value = float(text)
    except ValueError:
        return duration(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a time such as 2s or 1m30s")
    log.warning("%s: say the unit, %ss; a number alone will be refused", text, text)
    return value


def add_span(
    parser: argparse.ArgumentParser, name: str, text: str, *, default: str, older: str | None = None
) -> None:
    """Add an option `--NAME TIME`, whose value is seconds under `NAME_s`.

    `older` is how it was called when it took a number of seconds; it is understood and not shown.
    """
    into = f"{name.replace('-', '_')}_s"
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        f"--{name}", dest=into, type=duration, default=default, metavar="TIME",
        help=f"{text} (default {default})",
    )  # fmt: skip
    if older is not None:
        group.add_argument(f"--{older}", dest=into, type=float, default=default, help=argparse.SUPPRESS)


def picture_size(text: str) -> tuple[int, int]:
    """Width and height in pixels of a text such as 1920x1080, for argparse."""
    from lumpwatch.service.core import whole_number

    width, height = (whole_number(side, _MOST_PX) for side in (*text.split("x"), "", "")[:2])
    if text.count("x") != 1 or not (width and height and min(width, height) >= _LEAST_PX):
        raise argparse.ArgumentTypeError(
            f"'{text[:40]}' is not a size such as 1920x1080 ({_LEAST_PX} to {_MOST_PX} px)"
        )
    return width, height


_LEAST_PX, _MOST_PX = 16, 16384


def add_actor(parser: argparse.ArgumentParser, text: str, *, required: bool) -> None:
    """Add `--by NAME`; the older `--actor` means the same."""
    group = parser.add_mutually_exclusive_group(required=required)
    group.add_argument("--by", dest="actor", default="", metavar="NAME", help=text)
    group.add_argument("--actor", dest="actor", default="", metavar="NAME", help=argparse.SUPPRESS)
