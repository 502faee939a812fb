"""The order of words: `lumpwatch COMMAND [VERB] CONFIG …`.

Version 0.1 had the file before the verb in some commands, which is understood for one more release.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence


def verb_first(parser: argparse.ArgumentParser, given: Sequence[str]) -> list[str]:
    """The words after the command; where its verb comes second, as in 0.1, the two change places, with a warning."""
    words = list(given)
    verbs = next((tuple(a.choices or ()) for a in parser._actions if not a.option_strings), ())
    places = [index for index, _ in zip(_places(parser, words), range(2), strict=False)]
    if len(places) < 2 or words[places[0]] in verbs or words[places[1]] not in verbs:
        return words
    first, second = places
    words[first], words[second] = words[second], words[first]
    sys.stderr.write(
        f"{parser.prog} {words[first]}: write the verb before the file; this order will be refused\n"
    )
    return words


def _places(parser: argparse.ArgumentParser, words: Sequence[str]) -> Iterator[int]:
    """Where words stand that are neither options nor their values."""
    value_follows = False
    for index, word in enumerate(words):
        if value_follows:
            value_follows = False
        elif word == "--":
            yield from range(index + 1, len(words))
            return
        elif word.startswith("-") and word != "-":
            action = parser._option_string_actions.get(word)
            value_follows = action is not None and action.nargs != 0
        else:
            yield index
