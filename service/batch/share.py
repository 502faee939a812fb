"""A share of the tasks: so many runs side by side that know nothing of each other, as a Kubernetes Job starts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

from lumpwatch.service.core import whole_number
from lumpwatch.service.errors import ConfigError

T = TypeVar("T")
_MOST = 100_000


@dataclass(frozen=True, slots=True)
class Share:
    """Share `index` of `count`, from 0."""

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Of a text such as 3/100. Raises ConfigError."""
        index, slash, count = text.partition("/")
        i, n = whole_number(index, _MOST), whole_number(count, _MOST)
        if not slash or i is None or not n or i >= n:
            raise ConfigError(f"--share '{text[:40]}': expected INDEX/COUNT, from 0/COUNT on, such as 0/4")
        return cls(i, n)

    def of(self, tasks: Sequence[T]) -> Sequence[T]:
        """Every so manieth, so that what lies beside each other (and is as long) is spread."""
        return tasks[self.index :: self.count]
