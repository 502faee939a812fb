"""The `lumpwatch` command.

Exit codes: 0 good, 1 failed, 2 bad arguments or configuration. Expected failures are one line on
standard error; a traceback is a bug.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import NoReturn

from service.cli import (
    alarms,
    backtest,
    check,
    demo,
    evaluate,
    events,
    operate,
    priors,
    replay,
    run,
    schema,
    simulate,
    train,
)
from service.errors import LumpwatchError

_COMMANDS = (
    run,
    demo,
    replay,
    evaluate,
    backtest,
    train,
    priors,
    check,
    schema,
    alarms,
    operate,
    events,
    simulate,
)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def parser() -> argparse.ArgumentParser:
    """The command line with all commands."""
    top = _Parser(
        prog="lumpwatch",
        description="Watches the feed of a crusher and says in time that a large lump is coming.",
    )
    top.add_argument("--version", action="version", version=f"lumpwatch {version('lumpwatch')}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in _COMMANDS:
        command.add(commands)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    try:
        arguments = parser().parse_args(argv)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 2
    try:
        return int(arguments.command(arguments))
    except LumpwatchError as error:
        sys.stderr.write(f"lumpwatch: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of a pipe has gone (`lumpwatch alarms | head`): keep the interpreter from complaining.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        sys.stderr.write(f"lumpwatch: {error.filename or 'output'}: {error.strerror or error}\n")
        return 1
