"""What can stand on the command line, read from the parser: for the scripts that complete it."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Value:
    """What follows an option, or stands at a place: one of `choices`, a file, or anything else."""

    name: str
    choices: tuple[str, ...] = ()
    file: bool = False
    many: bool = False
    """Whether more of them may follow."""


@dataclass(frozen=True)
class Option:
    """An option with all its names; without a value it is a switch."""

    names: tuple[str, ...]
    help: str
    value: Value | None = None


@dataclass(frozen=True)
class Grammar:
    """One command."""

    name: str
    help: str
    options: tuple[Option, ...]
    places: tuple[Value, ...]
    """What stands without an option, in order."""


def grammar_of(name: str, parser: argparse.ArgumentParser) -> Grammar:
    """The grammar of one command; what its help does not show is left out."""
    shown = [action for action in parser._actions if action.help != argparse.SUPPRESS]
    options = [
        Option(tuple(action.option_strings), _line(action.help), _value(action) if _takes(action) else None)
        for action in shown
        if action.option_strings
    ]
    places = [_value(action) for action in shown if not action.option_strings]
    return Grammar(name, _line(parser.description), tuple(options), tuple(places))


def files_or_words(places: Iterable[Value]) -> tuple[bool, tuple[str, ...]]:
    """Whether any place takes a file, and all words that any place takes."""
    every = tuple(places)
    return any(place.file for place in every), tuple(word for place in every for word in place.choices)


def values(grammar: Grammar) -> Iterator[tuple[Option, Value]]:
    """The options that take a value."""
    for option in grammar.options:
        if option.value is not None:
            yield option, option.value


def _takes(action: argparse.Action) -> bool:
    return action.nargs != 0


def _value(action: argparse.Action) -> Value:
    metavar = action.metavar if isinstance(action.metavar, str) else action.dest
    choices = tuple(str(choice) for choice in action.choices or ())
    return Value(metavar, choices, action.type is Path, action.nargs in ("*", "+"))


def _line(text: str | None) -> str:
    """The first sentence, in one line."""
    return " ".join((text or "").split()).replace("%%", "%").partition(". ")[0].rstrip(".")
