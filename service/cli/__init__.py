"""The `lumpwatch` command.

Exit codes: 0 good, 1 failed, 2 bad arguments or configuration. Expected failures are one line on
standard error; a traceback is a bug.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import NoReturn

from lumpwatch.service.cli.compiled import unpack_kernels
from lumpwatch.service.cli.late import module_of
from lumpwatch.service.cli.overview import overview, unknown
from lumpwatch.service.cli.word_order import verb_first
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.threads import use_one_thread

_MODULES = {
    "arguments.run": ("run",),
    "arguments.console": ("console",),
    "arguments.users": ("users",),
    "arguments.gateway": ("gateway",),
    "health": ("health",),
    "arguments.demo": ("demo",),
    "arguments.replay": ("replay",),
    "arguments.evaluate": ("evaluate",),
    "arguments.backtest": ("backtest",),
    "arguments.train": ("train",),
    "arguments.refine": ("refine",),
    "arguments.reference": ("reference",),
    "arguments.priors": ("priors",),
    "arguments.check": ("check",),
    "arguments.bench": ("bench",),
    "init": ("init",),
    "arguments.snapshot": ("snapshot", "record"),
    "arguments.schema": ("schema",),
    "arguments.alarms": ("alarms",),
    "arguments.operate": ("ack", "reset", "shelve", "unshelve", "service"),
    "arguments.events": ("events",),
    "arguments.evidence": ("evidence",),
    "arguments.verdict": ("verdict",),
    "arguments.labels": ("labels",),
    "arguments.report": ("report",),
    "arguments.proof": ("proof",),
    "arguments.lens": ("lens",),
    "arguments.simulate": ("simulate",),
    "arguments.deploy": ("deploy",),
    "completion": ("completion",),
}
"""Modules of this package that add commands, by what they add. Only the one that is asked for is imported, and what a
command does only when it is to be done."""
_WITH_VERBS = ("evidence", "service", "users", "verdict")
"""Commands whose verb 0.1 had behind the file."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def of_command(top: argparse.ArgumentParser, command: str) -> argparse.ArgumentParser:
    """The parser of one command."""
    actions = (action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    found: argparse.ArgumentParser = next(actions).choices[command]
    return found


def parser(command: str | None = None) -> argparse.ArgumentParser:
    """The command line with all commands, or with one (and those of its module); `--version` needs none."""
    top = _Parser(
        prog="lumpwatch",
        description="Watches the feed of a crusher and says in time that a large lump is coming.",
    )
    top.add_argument("--version", action="version", version=f"lumpwatch {version('lumpwatch')}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    modules = [module for module, names in _MODULES.items() if command is None or command in names]
    for module in modules:
        module_of(module).add(commands)
    return top


@contextmanager
def _loudness(level: str | None) -> Iterator[None]:
    """`--quiet` or `--verbose`, for as long as the command runs; its worker processes inherit it."""
    if level is None:
        yield
        return
    from lumpwatch.service.core import LEVEL, log_to_stderr

    before = os.environ.get(LEVEL)
    os.environ[LEVEL] = level
    try:
        log_to_stderr()
        yield
    finally:
        if before is None:
            del os.environ[LEVEL]
        else:
            os.environ[LEVEL] = before


def _one_line(error: LumpwatchError) -> str:
    """What it says. Where packages of the service are missing, so is what prints it, and the words are our own."""
    try:
        from lumpwatch.service.core import printable
    except ModuleNotFoundError:
        return str(error)
    return printable(str(error))


def _escape_what_cannot_be_printed() -> None:
    """A terminal that is not UTF-8, or a file whose name is not, is no reason to end with an error."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    use_one_thread()
    unpack_kernels()
    _escape_what_cannot_be_printed()
    given = list(sys.argv[1:] if argv is None else argv)
    known = [name for names in _MODULES.values() for name in names]
    if given and not given[0].startswith("-") and given[0] not in known:
        sys.stderr.write(unknown(given[0], known))
        return 2
    alone = {"--version", *known}
    try:
        if given in (["--help"], ["-h"]):
            sys.stdout.write(overview())
            sys.stdout.flush()
            return 0
        command = given[0] if given and given[0] in alone else None
        top = parser(command)
        if command in _WITH_VERBS:
            given = [command, *verb_first(of_command(top, command), given[1:])]
        arguments = top.parse_args(given)
        with _loudness(getattr(arguments, "log_level", None)):
            return int(arguments.command(arguments))
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 2
    except LumpwatchError as error:
        sys.stderr.write(f"lumpwatch: {_one_line(error)}\n")
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
