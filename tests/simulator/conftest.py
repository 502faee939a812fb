"""Ore and rocks of a seed are drawn once for all tests here: that is most of what making a feed costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator

from lumpwatch.service.simulator import site, stock

Draw = Callable[..., Any]
ANEW = {
    "test_a_feed_stays_what_it_was",
    "test_the_same_spec_gives_the_same_bytes",
    "test_everything_at_once_is_deterministic",
}
"""Tests of the drawing itself: for them everything is drawn again."""
MOST = 400


class Drawn:
    """What functions of a generator gave, by its state and the other arguments; leaves it as they would."""

    def __init__(self) -> None:
        self._kept: dict[object, tuple[Any, Any]] = {}

    def once(self, draw: Draw) -> Draw:
        """The same function, which works only once for the same arguments."""

        def drawn(rng: Generator, *arguments: Any) -> Any:
            key = (draw.__name__, repr(rng.bit_generator.state), *map(repr, arguments))
            if key not in self._kept:
                while len(self._kept) >= MOST:
                    self._kept.pop(next(iter(self._kept)))
                self._kept[key] = draw(rng, *arguments), rng.bit_generator.state
            found, rng.bit_generator.state = self._kept[key]
            # Shapes are shared by the lumps of a feed as it is; a bed is its feed's own.
            return found.copy() if isinstance(found, np.ndarray) else found

        return drawn


@pytest.fixture(scope="session")
def all_drawn() -> Drawn:
    return Drawn()


@pytest.fixture(autouse=True)
def drawn_once(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, all_drawn: Drawn) -> None:
    if request.node.originalname in ANEW:
        return
    for module, name in ((site, "rubble"), (site, "cobbles"), (stock, "rock")):
        monkeypatch.setattr(module, name, all_drawn.once(getattr(module, name)))
