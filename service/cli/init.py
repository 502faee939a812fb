"""`lumpwatch init`: five questions, and a commented configuration file."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

from lumpwatch.service.cli.options import Commands, add_command, add_json, tell_json
from lumpwatch.service.errors import ConfigError, LumpwatchError

_QUESTIONS = (
    ("site", "Name of the site", "north-pit"),
    ("camera", "Name of the camera", "crusher-1"),
    ("source", "Its address (rtsp://user:${CAM_PASSWORD}@host/stream), a file, or sim:feed", "sim:feed"),
    ("roi", "Name of the region that is watched", "apron"),
    ("limit_mm", "Longest lump that the crusher takes, mm (empty: not known yet)", ""),
)
_TEXT = """\
# lumpwatch; every key is explained in docs/reference/configuration.md.
site: {site}

# Where priors, event log and evidence are kept; a relative path counts from this file.
store: {{path: var}}

cameras:
  - id: {camera}
    # Secrets stay outside: ${{CAM_PASSWORD}} is that environment variable, or the file that CAM_PASSWORD_FILE names.
    source: {{url: {source}}}
    rois:
      - id: {roi}
        # Around the part of the picture where a lump can be, from where it enters to where it disappears:
        # shares of width and height, (0, 0) top left, (1, 1) bottom right. Draw it on the picture of
        #   lumpwatch snapshot {file} --out {camera}.png
        polygon: [[0.15, 0.10], [0.85, 0.10], [0.85, 0.98], [0.15, 0.98]]

        # Where the belt lies in the picture gives sizes in mm and seconds to the lip. Put in what you measured, take
        # the marks away, and look at it with
        #   lumpwatch check {file} --picture {camera}.png --out grid.png
        # calibration:
        #   width:
        #     {{far: [[0.32, 0.20], [0.68, 0.20]], near: [[0.16, 0.70], [0.84, 0.70]], width_mm: 2400, view_deg: 58}}
        #   lip: [[0.15, 0.77], [0.85, 0.77]]
        #   limit_mm: {limit}   # the alarm is for lumps that are longer

        # When the alarm is raised and cleared; a lower raise_above warns earlier and errs more often.
        alarm: {{raise_above: 0.999, clear_below: 0.5, on_delay_s: 0.5, off_delay_s: 2.0, latch: true}}
"""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "init",
        init,
        "Ask five questions and write a commented configuration file. Answers may be given as options, "
        "or as lines of standard input.",
        "lumpwatch init site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="file to write; it must not exist")
    for name, question, usual in _QUESTIONS:
        option = name.replace("_", "-")
        parser.add_argument(
            f"--{option}", dest=name, metavar="TEXT", help=f"{question} (usual: {usual or 'none'})"
        )
    parser.add_argument(
        "--defaults", action="store_true", help="ask nothing: take what is usual for the rest"
    )
    add_json(parser, "print what was written and the answers as JSON")


def init(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.config.exists():
        raise ConfigError(f"{arguments.config}: exists; it is not overwritten")
    given = {name: getattr(arguments, name) for name, *_ in _QUESTIONS}
    found = answers(given, None if arguments.defaults else _ask)
    text = configuration(str(arguments.config), found)
    try:
        arguments.config.write_text(text, encoding="utf-8")
    except OSError as error:
        raise LumpwatchError(f"{arguments.config}: cannot be written ({error.strerror})") from error
    if arguments.json:
        tell_json({"file": str(arguments.config), **{name: found[name] or None for name in found}})
        return 0
    sys.stdout.write(
        f"{arguments.config} is written. Next: lumpwatch check {arguments.config} --connect, then draw the polygon "
        "(docs/commissioning.md).\n"
    )
    return 0


def answers(given: dict[str, str | None], ask: Callable[[str, str], str] | None) -> dict[str, str]:
    """An answer to each question: the given one, else what `ask` says, else what is usual."""
    found = {}
    for name, question, usual in _QUESTIONS:
        answer = given.get(name)
        if answer is None:
            answer = (ask(question, usual) if ask is not None else "") or usual
        found[name] = answer.strip()
    return found


def configuration(file: str, found: dict[str, str]) -> str:
    """The text of the file. Raises ConfigError for an answer that cannot stand there."""
    limit = found["limit_mm"] or "600"
    if not re.fullmatch(r"[0-9]{1,9}(\.[0-9]{0,9})?", limit) or not float(limit):
        raise ConfigError(f"limit_mm: expected millimetres, found '{limit}'")
    text = _TEXT.format(
        file=file,
        site=json.dumps(found["site"]),
        camera=found["camera"],
        roi=found["roi"],
        source=json.dumps(found["source"]),
        limit=limit,
    )
    from lumpwatch.service.config import parse_config

    parse_config(text, file, secrets=False)
    return text


def _ask(question: str, usual: str) -> str:
    if sys.stdin.isatty():
        sys.stderr.write(f"{question}{f' [{usual}]' if usual else ''}: ")
        sys.stderr.flush()
    return sys.stdin.readline().strip()
