"""`lumpwatch completion`: a script that completes the command line in a shell, written from the parser."""

from __future__ import annotations

import argparse
import sys

from lumpwatch.service.cli.grammar import Grammar, grammar_of
from lumpwatch.service.cli.options import Commands, add_command
from lumpwatch.service.cli.overview import GROUPS
from lumpwatch.service.cli.shells import SHELLS
from lumpwatch.service.errors import LumpwatchError


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "completion",
        completion,
        "Print a script that completes commands, options, their values and files in a shell. Write it to a file "
        "once and again after each upgrade: bash reads ~/.local/share/bash-completion/completions/lumpwatch, zsh "
        "a file _lumpwatch in a folder of fpath, fish ~/.config/fish/completions/lumpwatch.fish.",
        "lumpwatch completion bash > ~/.local/share/bash-completion/completions/lumpwatch",
    )
    parser.add_argument("shell", choices=tuple(SHELLS), help="for which shell")


def completion(arguments: argparse.Namespace) -> int:
    """Run the command."""
    sys.stdout.write(SHELLS[arguments.shell](grammars()))
    return 0


def grammars() -> list[Grammar]:
    """Of every command that can run here: some need packages of an extra."""
    # Only this command looks at all the others, so it asks for them when it runs.
    from lumpwatch.service.cli import of_command, parser

    found = []
    for name in (name for group in GROUPS.values() for name in group):
        try:
            found.append(grammar_of(name, of_command(parser(name), name)))
        except LumpwatchError:
            continue
    return found
