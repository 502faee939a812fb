"""`lumpwatch users`: who may use the console."""

from __future__ import annotations

import argparse
import getpass
import sys

from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import UserRole, load_config
from lumpwatch.service.console import UserFile, UsersError
from lumpwatch.service.errors import ConfigError


def users(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if (arguments.what == "list") != (arguments.name is None):
        raise ConfigError(f"users {arguments.what} {'takes no' if arguments.name else 'needs a'} NAME")
    if (arguments.what in ("add", "role")) != (arguments.role is not None):
        raise ConfigError("users add and users role need --role, and only they do")
    config = load_config(arguments.config)
    if config.console.users is None:
        raise ConfigError(f"{arguments.config}: console.users: names no file")
    file = UserFile(config.console.users)
    if arguments.what == "add":
        file.put(arguments.name, _password(arguments.name), UserRole.named(arguments.role))
    elif arguments.what == "role":
        file.set_role(arguments.name, UserRole.named(arguments.role))
    elif arguments.what == "remove":
        file.remove(arguments.name)
    if arguments.json:
        tell_json([{"name": user.name, "role": user.role.label} for user in file.all()])
    elif arguments.what == "list":
        for user in file.all():
            sys.stdout.write(f"{user.name}  {user.role.label}\n")
    return 0


def _password(name: str) -> str:
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    password = getpass.getpass(f"Password of {name}: ")
    if getpass.getpass("Again: ") != password:
        raise UsersError("the two passwords differ")
    return password
