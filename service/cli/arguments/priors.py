"""Arguments of `lumpwatch priors`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "priors",
        late("priors", "priors"),
        "List the stored versions of a ROI's prior, draw one, try one in shadow, promote or drop what runs in "
        "shadow, go back to one, or move one elsewhere. A running daemon follows without a restart.",
        "lumpwatch priors rollback site.yaml --camera crusher-1 --roi apron --version 3",
    )
    parser.add_argument(
        "action",
        choices=("list", "show", "shadow", "promote", "drop", "rollback", "export", "import"),
        help="what to do; shadow prints how the trial goes, or begins one with --version",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "file", type=Path, nargs="?", metavar="FILE", help="PNG (show) or prior file (export, import)"
    )
    parser.add_argument("--camera", metavar="ID", help="camera of the prior (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the prior (default: the only one)")
    parser.add_argument(
        "--version",
        type=int,
        metavar="N",
        help="version (default: the one in use; promote, drop: the one in shadow; rollback to 0: stated defaults)",
    )
    parser.add_argument("--shadow", action="store_true", help="import: to run in shadow, not to be used")
    add_json(
        parser,
        "print the versions as JSON (list), or what was done and which versions are in use and in shadow",
    )
