"""From the running counts of an inbox to the counters of the metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, TypeVar

_Reason = TypeVar("_Reason", bound=str)


class Dropped(Protocol):
    """Counts frames that were not processed."""

    def __call__(self, reason: str, count: int = 1) -> None:
        """So many more."""


class InboxCounts:
    """Remembers what was counted already."""

    def __init__(self, dropped: Dropped) -> None:
        self._dropped = dropped
        self._counted: dict[str, int] = {}

    def publish(self, skipped: int, malformed: Mapping[_Reason, int]) -> None:
        """Count what is new of the frames that newer ones replaced, and of the messages that were none, by reason."""
        counts = {"skipped": skipped}
        counts |= {f"malformed_{reason}": count for reason, count in dict(malformed).items()}
        for reason, count in counts.items():
            if (new := count - self._counted.get(reason, 0)) > 0:
                self._dropped(reason, new)
                self._counted[reason] = count
