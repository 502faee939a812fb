"""Arguments of `lumpwatch ack`, `shelve`, …: the options are the fields of the command's request on the bus."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_actor, add_command, add_json

CLASSES = ("lump", "blind", "system", "blocked")
"""As `AlarmClass` calls them."""
_WHERE = "--camera crusher-1 --roi apron --by anna"


def add(commands: Commands) -> None:
    """Add the commands."""
    _add(commands, "ack", "Acknowledge an alarm of a running daemon.")
    _add(commands, "reset", "Reset an alarm that is over and acknowledged, but latched.")
    parser = _add(
        commands,
        "shelve",
        "Keep an alarm from being announced for a limited time; the condition is judged and recorded on.",
        example=' --for 30m --reason "dust from the repair"',
    )
    parser.add_argument("--reason", required=True, metavar="TEXT", help="why")
    parser.add_argument(
        "--for",
        required=True,
        dest="for_s",
        metavar="TIME",
        help="for how long, at most shelve_max_s: 90s, 30m, 1h30m",
    )
    _add(commands, "unshelve", "End the shelving of an alarm.")
    parser = _add(
        commands,
        "service",
        "Take an alarm out of service, or put it back in; it stays out until then.",
        verbs={"state": ("out", "in")},
        verbs_help="out of service, or in again",
        example=' --reason "camera is being moved"',
    )
    parser.add_argument("--reason", metavar="TEXT", help="why; needed for out")


def _add(
    commands: Commands,
    name: str,
    text: str,
    *,
    verbs: dict[str, tuple[str, ...]] | None = None,
    verbs_help: str = "",
    example: str = "",
) -> argparse.ArgumentParser:
    """One of them; `verbs` are words before CONFIG, by the field that they fill."""
    first = "".join(f"{words[0]} " for words in (verbs or {}).values())
    shown = f"lumpwatch {name} {first}site.yaml {_WHERE}{example}"
    parser = add_command(commands, name, late("operate", "operate"), text, shown)
    parser.set_defaults(operation=name)
    for field, words in (verbs or {}).items():
        parser.add_argument(field, choices=words, help=verbs_help)
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="camera of the alarm (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the alarm (default: the only one)")
    add_actor(parser, "who does it; it is recorded", required=True)
    parser.add_argument(
        "--class",
        dest="alarm_class",
        choices=CLASSES,
        default="lump",
        help="lump (default), blind: the ROI cannot judge, system: it judges late, or a proof test failed, or "
        "blocked: the mouth is",
    )
    add_json(parser, "print what became of the alarm as JSON")
    return parser
