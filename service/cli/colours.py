"""Colours of the states on a terminal."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TextIO

_RED, _VIOLET, _PLAIN = "\x1b[1;31m", "\x1b[1;35m", "\x1b[0m"
_COLOURS = {
    "LUMP": _RED,
    "BLIND": _VIOLET,
    "SILENT": _VIOLET,  # as BLIND: in both nobody knows what comes
    "raised": _RED,
    "blind raised": _VIOLET,
}
"""Of a state, and of the record of an alarm: one of a lump does not name its class."""
STYLES = {"LUMP": "bold red", "BLIND": "bold magenta"}
"""The same for tables; rich honours `NO_COLOR` and what is no terminal by itself."""
_STATE = re.compile(r"\b(LUMP|BLIND|SILENT)\b|(?<=: )(?:TEST )?(raised|blind raised)\b")


def wanted(stream: TextIO, environment: Mapping[str, str]) -> bool:
    """Whether to colour: on a terminal that can, unless `NO_COLOR` holds anything (no-color.org)."""
    return not environment.get("NO_COLOR") and environment.get("TERM") != "dumb" and stream.isatty()


def change_style(alarm_class: str, change: str) -> str:
    """How a table shows a change of an alarm: as the record of it is shown by `coloured`."""
    return STYLES.get(alarm_class.upper(), "") if change in ("raised", "re_alarmed") else ""


def coloured(line: str) -> str:
    """The line with its states in their colours. It must be printable already: colours are control characters."""
    return _STATE.sub(lambda found: f"{_COLOURS[found[1] or found[2]]}{found[0]}{_PLAIN}", line)
