"""Arguments of `lumpwatch users`."""

from __future__ import annotations

from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json

ROLES = ("viewer", "operator", "engineer")
"""As `UserRole` calls them."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "users",
        late("users", "users"),
        "List, add, change or remove the users of the console. The password is asked for, or read from standard "
        "input where that is no terminal; a running console follows at once.",
        "lumpwatch users add site.yaml anna --role operator",
    )
    parser.add_argument("what", choices=("list", "add", "role", "remove"), help="what to do")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("name", nargs="?", metavar="NAME", help="the user (add, role, remove)")
    parser.add_argument("--role", choices=ROLES, help="what the user may do (add, role)")
    add_json(parser, "print the users as JSON, after what was done")
