"""Text from outside on its way to a terminal or a log: it must not pass for other lines, nor command a terminal."""

from __future__ import annotations

import re

LONGEST = 4000
"""Characters of one line."""
# C0 and C1 control characters, line and paragraph separators, and marks that turn the direction of text.
_UNPRINTABLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u2028\u2029\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


def printable(text: str, longest: int = LONGEST) -> str:
    r"""The text as one line, what cannot be printed as `\xNN` or `\uNNNN`, cut with how much is left out."""
    more = len(text) - longest
    shown = _UNPRINTABLE.sub(_escaped, text[:longest] if more > 0 else text)
    return f"{shown}… ({more} more characters)" if more > 0 else shown


def printable_lines(text: str, longest: int = LONGEST, most: int = 200) -> str:
    """The same line by line, `most` of them: tracebacks have several."""
    lines = text.split("\n")
    shown = [printable(line, longest) for line in lines[:most]]
    if len(lines) > most:
        shown.append(f"… ({len(lines) - most} more lines)")
    return "\n".join(shown)


def _escaped(found: re.Match[str]) -> str:
    code = ord(found[0])
    return {9: " ", 10: "\\n", 13: "\\r"}.get(code) or (f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}")
