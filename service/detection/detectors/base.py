"""What every detector takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief
from lumpwatch.service.core import Detection
from lumpwatch.service.errors import LumpwatchError

LONGEST_STEP_S = 2.0
"""After a longer gap between frames the objects may be anywhere: the search starts anew."""
SHOWN_ABOVE = 0.5
"""Existence from which an object is reported."""


class StateMismatchError(LumpwatchError):
    """A stored state is not one of this detector."""


@dataclass(frozen=True, slots=True)
class FilterState:
    """All that changes in a filter from frame to frame, as plain data."""

    plain: dict[str, Any]
    """What JSON can hold: numbers of objects, the random generator."""
    arrays: dict[str, NDArray[Any]]
    """Copies of the filter's arrays."""


class Detector(Protocol):
    """The detector of one ROI with what changes from frame to frame."""

    learns: bool
    """Whether the next pictures may teach it what the background looks like; False while they are not fit."""

    @property
    def roi(self) -> Roi:
        """Its geometry."""

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        """One working picture (h, w), `dt` seconds after the last; colour (h, w, 3) where it asks for it."""

    def use(self, learned: Learned | None) -> None:
        """Take another prior. Raises PriorMismatchError, and is then as before."""

    def clouds(self) -> tuple[Belief, ...]:
        """All particle clouds after the last step, for overlays and plots."""

    def state(self) -> FilterState | None:
        """What the next step depends on; None where this kind of detector cannot export it."""

    def restore(self, state: FilterState) -> None:
        """Go on from a state of a detector with the same configuration and prior. Raises StateMismatchError."""
