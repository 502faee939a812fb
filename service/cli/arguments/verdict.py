"""Arguments of `lumpwatch verdict`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_actor, add_command, add_json

OUTCOMES = ("true", "false", "unsure")
"""As `VerdictOutcome` calls them."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "verdict",
        late("verdict", "verdict"),
        "Say whether an alarm was true; the last word counts, all are kept. For reports and training.",
        'lumpwatch verdict false site.yaml --camera crusher-1 --roi apron --alarm 12 --by anna --note "dust"',
    )
    parser.add_argument("verdict", choices=OUTCOMES, help="what the alarm was")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="camera of the alarm (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the alarm (default: the only one)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--alarm", metavar="SEQ|ID", help="a record of the alarm, by its sequence or id (default: the last)"
    )
    which.add_argument("--evidence", metavar="ID", help="the alarm of that evidence")
    add_actor(parser, "who says it; it is recorded", required=True)
    parser.add_argument("--note", default="", metavar="TEXT", help="why")
    add_json(parser, "print what was recorded as JSON")
