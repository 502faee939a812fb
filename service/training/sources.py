"""What a prior says of the clips that it learned from, and which of them a refinement lacks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import PurePath

_BETWEEN = " + "
_BETWEEN_OLD = ", "
"""Priors that `train` stored before 0.2 name their clips so."""


def sources_text(names: Iterable[str]) -> str:
    """The clips by name, without their folders, as a prior keeps them."""
    return _BETWEEN.join(PurePath(name).name for name in names)


def missing_sources(text: str, names: Sequence[str]) -> tuple[str, ...]:
    """The clips of a prior's text that are not among these; one that it names twice must be there twice."""
    known = sorted({PurePath(name).name for name in names}, key=len, reverse=True)
    learned: list[str] = []
    while text:
        name, text = _first(text, known)
        learned.append(PurePath(name).name)
    missing = Counter(learned) - Counter(PurePath(name).name for name in names)
    return tuple(missing.elements())


def _first(text: str, known: Sequence[str]) -> tuple[str, str]:
    """The first name and what follows. A known name may hold what stands between names, another may not."""
    for name in known:
        rest = text.removeprefix(name)
        if text.startswith(name) and (not rest or rest.startswith((_BETWEEN, _BETWEEN_OLD))):
            return name, rest.removeprefix(_BETWEEN if rest.startswith(_BETWEEN) else _BETWEEN_OLD)
    ends = [end for between in (_BETWEEN, _BETWEEN_OLD) if (end := text.find(between)) > 0]
    if not ends:
        return text, ""
    rest = text[min(ends) :]
    return text[: min(ends)], rest.removeprefix(_BETWEEN if rest.startswith(_BETWEEN) else _BETWEEN_OLD)
